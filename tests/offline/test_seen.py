import numpy as np

from tests.networks import grid_network
from tsc_missing.offline.plan import CollectSettings, draw_spec
from tsc_missing.offline.seen import saw_nothing, seen_by_policies, unaware_set

GRID = grid_network(3, 4)


def specs(count, **given):
    settings = CollectSettings(nets=("a", "b"), episodes=count, horizon=600, **given)
    return [draw_spec(settings, number) for number in range(count)]


def test_what_is_lost_comes_in_turn_for_each_network():
    found = specs(8, lost=("kriging", "none"))
    assert [spec.lost for spec in found] == ["kriging", "kriging", "none", "none"] * 2
    assert all(spec.lost == "none" for spec in specs(3))


def test_who_loses_something_is_drawn_for_each_episode():
    first, _, _, fourth = specs(4, lost=("kriging",), unaware=0.0)
    masks = [seen_by_policies(spec, GRID) for spec in (first, fourth)]
    assert masks[0].shape == (40, GRID.n, 12)
    assert (masks[0] == seen_by_policies(first, GRID)).all()
    assert (masks[0] != masks[1]).any()
    blind = ~masks[0].any(axis=(0, 2))
    assert 1 <= blind.sum() <= 5
    assert (saw_nothing(first, GRID) == blind).all()


def test_unaware_intersections_saw_nothing_either():
    (spec,) = specs(1, lost=("random",), unaware=1.0)
    seen = seen_by_policies(spec, GRID)
    assert not seen.all()
    assert seen.any(axis=(0, 2)).all()
    told = unaware_set(spec.unaware, spec.seed, GRID.n)
    assert told.any()
    assert (saw_nothing(spec, GRID) == told).all()


def test_where_nothing_is_lost_everything_is_seen():
    (spec,) = specs(1, unaware=0.0)
    assert seen_by_policies(spec, GRID).all()
    assert not np.any(saw_nothing(spec, GRID))


def test_other_draws_of_an_episode_do_not_depend_on_what_is_lost():
    plain, lossy = specs(3)[2], specs(3, lost=("mixed",), min_space=9)[2]
    assert plain.model_copy(update={"lost": "mixed", "min_space": 9}) == lossy
