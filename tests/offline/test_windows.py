import dataclasses
import re
import time

import numpy as np
import pytest

pytest.importorskip("torch", reason="the diffusion controller needs torch")

import torch

from tests.networks import grid_network, sharing_lanes, tee_network
from tests.offline.cases import made_up_dataset
from tsc_missing.errors import UserError
from tsc_missing.offline.dataset import EPISODES, MANIFEST, read_dataset
from tsc_missing.offline.pool import EpisodePool
from tsc_missing.offline.seen import unaware_set
from tsc_missing.offline.window_masks import MaskMix, draw_masks
from tsc_missing.offline.windows import Draw, WindowSampler

C, H = 5, 3
T = C + H
OFF = dict.fromkeys(("none", "random", "blind", "near", "lane", "burst", "mixed"), 0.0)


def only(pattern, **values):
    return MaskMix(**{**OFF, pattern: 1.0}, **values)


@pytest.fixture(scope="module", params=["grids", "tee", "holes"])
def dataset(request, tmp_path_factory):
    networks = {"wide": grid_network(2, 4), "tall": grid_network(3, 2)}
    if request.param == "tee":
        networks["tee"] = tee_network()
    folder = tmp_path_factory.mktemp("data") / request.param
    return made_up_dataset(folder, networks, holes=0.3 if request.param == "holes" else 0.0)


def sampler(dataset, mix=None, **options):
    return WindowSampler(dataset, C, H, mix or MaskMix(), seed=7, **options)


def brute_force(dataset, episode, n, start):
    """A window cell by cell: values, recorded, green, red steps of own and neighbour slots."""
    log = dataset.load(episode)
    network = dataset.networks[dataset.manifest.episodes[episode].spec.net]

    def cell(t, m, slot):
        red = log.red_steps[max(t, 0), m, slot]
        if t < 0:
            return (None, False, red == 0, red)
        values = tuple(log.values[t, m, slot])
        return (values, bool(log.recorded[t, m, slot]), red == 0, red)

    own = [[cell(start + k, n, slot) for slot in range(12)] for k in range(T)]
    near = [
        [
            None if flat < 0 else [cell(start + k, *divmod(int(flat), 12)) for k in range(T)]
            for flat in network.neighbours[n, slot]
        ]
        for slot in range(12)
    ]
    down = [
        [[cell(start + k, *divmod(int(flat), 12)) for k in range(T)] for flat in roads if flat >= 0]
        for roads in network.downstream[n]
    ]
    return own, near, down, log.phase[start + C - 1, n], network


def check_roads(expected, w, b, slot):
    assert w.down_exists[b, slot].sum() == len(expected)
    for j, cells in enumerate(expected):
        for k, (values, known, _, _) in enumerate(cells):
            assert bool(w.down_given[b, slot, j, k]) == known
            if known:
                assert tuple(w.down_values[b, slot, j, k].tolist()) == values


def check_cell(expected, values, recorded, green, red):
    wanted, known, was_green, was_red = expected
    assert bool(recorded) == known
    assert bool(green) == bool(was_green)
    assert int(red) == int(was_red)
    if known:
        assert tuple(values.tolist()) == wanted


def test_windows_equal_brute_force(dataset):
    made = sampler(dataset, only("none"), told_all=1.0)
    made.sample(0, 4)
    rng = np.random.default_rng(3)
    draw = made.draw(40, rng)
    draw.start[:6] = [-4, -1, 0, -2, -3, 0]
    w = made.windows(draw, rng)
    groups = w.near_exists.shape[1]
    for b in range(40):
        episode = int(made._pool.episode[draw.place[b]])
        n, start = int(draw.intersection[b]), int(draw.start[b])
        own, near, down, action, network = brute_force(dataset, episode, n, start)
        assert w.action[b] == action
        assert torch.equal(w.slots[b], torch.from_numpy(network.slot_mask[n]))
        phases = network.phases.shape[1]
        assert torch.equal(w.phases[b, :phases], torch.from_numpy(network.phases[n]))
        assert w.phase_mask[b].sum() == network.phase_mask[n].sum()
        for k in range(T):
            for slot in range(12):
                at = (b, k, slot)
                check_cell(own[k][slot], w.values[at], w.recorded[at], w.green[at], w.red_steps[at])
        for slot in np.flatnonzero(network.slot_mask[n]):
            g = slot * groups // 12
            for j in range(3):
                assert bool(w.near_exists[b, g, j]) == (near[slot][j] is not None)
                for k in range(T) if near[slot][j] is not None else ():
                    at = (b, g, j, k)
                    check_cell(
                        near[slot][j][k],
                        w.near_values[at],
                        w.near_given[at],
                        w.near_green[at],
                        w.near_red_steps[at],
                    )
        for slot in range(12):
            check_roads(down[slot], w, b, slot)
    assert not w.near_given[~w.near_exists].any()
    assert not w.down_given[~w.down_exists].any()


def test_same_seed_and_step_same_windows(dataset):
    one, other = sampler(dataset, resident=3, renew=2), sampler(dataset, resident=3, renew=2)
    for step in range(6):
        first = one.sample(step, 16)
    again, next_one = other.sample(5, 16), other.sample(6, 16)
    for field in dataclasses.fields(first):
        assert torch.equal(*(getattr(w, field.name).nan_to_num() for w in (first, again)))
    assert not torch.equal(first.values, next_one.values)


def test_pool_is_bounded_and_meets_every_episode(dataset):
    pool = EpisodePool(dataset, seed=1, resident=2, renew=3)
    met = set()
    for step in range(0, 40):
        pool.advance(step)
        assert len(set(pool.episode)) <= 2
        met |= set(pool.episode.tolist())
    assert met == set(range(5))


def test_blind_windows_are_where_the_policy_was_blind_too(dataset):
    made = sampler(dataset)
    made.sample(0, 4)
    rng = np.random.default_rng(0)
    draw, hidden = made.draw(300, rng), rng.random(300) < 0.5
    moved = made._where_blind(draw, hidden, rng)
    assert (moved.place == draw.place).all()
    assert (moved.start == draw.start).all()
    unaware = [made._pool.unaware[place] for place in draw.place]
    for k, some in enumerate(unaware):
        if hidden[k] and len(some):
            assert moved.intersection[k] in some
        else:
            assert moved.intersection[k] == draw.intersection[k]
    for place, some in enumerate(made._pool.unaware):
        spec = dataset.manifest.episodes[made._pool.episode[place]].spec
        told = unaware_set(spec.unaware, spec.seed, dataset.networks[spec.net].n)
        assert told[some].all()


def test_no_future_is_told_by_sensors(dataset):
    plain = sampler(dataset, told_all=0.0).sample(0, 200)
    assert not plain.near_given[..., C:].any()
    assert plain.near_given[..., :C].any()


def shares(pattern, **values):
    """Seen shares of own and of another intersection, and own masks (B, 12, T)."""
    own = np.zeros(3000, dtype=np.int64)
    masks = draw_masks(only(pattern, **values), own, np.random.default_rng(0))
    slots = np.broadcast_to(np.arange(12), (3000, 12))
    mine = masks.seen(np.zeros_like(slots), slots, T)
    other = masks.seen(np.full_like(slots, 4), slots, T)
    return mine, other, masks


@pytest.mark.parametrize("pattern", ["random", "lane", "burst"])
def test_rates_of_patterns(pattern):
    mine, other, masks = shares(pattern, rate_min=0.4, rate_max=0.4)
    assert mine.mean() == pytest.approx(0.6, abs=0.03)
    assert other.mean() == pytest.approx(0.6, abs=0.03)
    alike = (mine == mine[:, :1]).all()
    assert alike == (pattern != "lane")
    changes = (mine[:, 0, 1:] != mine[:, 0, :-1]).mean()
    assert (changes < 0.25) == (pattern == "burst")
    assert not masks.own_blind.any()
    assert np.corrcoef(mine[:, 0, 0], other[:, 0, 0])[0, 1] == pytest.approx(0, abs=0.08)


def test_kriging_masks_hide_whole_trajectories():
    mine, other, _ = shares("blind", blind_near=0.2)
    assert not mine.any()
    assert (other == other[:, :1, :1]).all()
    assert other.mean() == pytest.approx(0.8, abs=0.03)
    mine, other, _ = shares("near", near_blind=0.3)
    assert mine.all()
    assert other.mean() == pytest.approx(0.7, abs=0.03)


def test_blind_windows_are_not_observable(dataset):
    w = sampler(dataset, only("blind")).sample(0, 50)
    assert w.hidden.all()
    assert not w.observable.any()
    assert sampler(dataset, only("random")).sample(0, 50).observable.all()


def test_fast_enough_not_to_limit_training(dataset):
    made = sampler(dataset)
    made.sample(0, 1024)
    began = time.process_time()
    for step in range(1, 6):
        made.sample(step, 1024)
    assert 5 * 1024 / (time.process_time() - began) > 2000  # more than 10 000 on a free core


def test_slots_that_share_sensors_are_hidden_together(tmp_path):
    network = sharing_lanes(grid_network(2, 3))
    data = made_up_dataset(tmp_path / "a", {"shared": network})
    common = network.slots_in_common
    assert (common != np.arange(12)).any()
    made = sampler(data, only("lane", rate_min=0.5, rate_max=0.5))
    made.sample(0, 4)
    rng = np.random.default_rng(0)
    draw = made.draw(400, rng)
    w = made.windows(draw, rng)
    together = np.take_along_axis(w.hidden.numpy(), common[draw.intersection][:, None], axis=2)
    np.testing.assert_array_equal(w.hidden.numpy(), together)
    assert w.hidden.float().mean() == pytest.approx(0.5, abs=0.05)
    roads = network.downstream[draw.intersection]
    pairs = {}
    for b, slot, j in zip(*np.nonzero(roads >= 0), strict=True):
        n, other = divmod(int(roads[b, slot, j]), 12)
        given = tuple(w.down_given[b, slot, j].tolist())
        pairs.setdefault((b, n, common[n, other]), set()).add(given)
    assert all(len(told) == 1 for told in pairs.values())


def test_a_lone_intersection_has_windows(dataset, tmp_path):
    data = made_up_dataset(tmp_path / "a", {"one": grid_network(1, 1)})
    assert data.networks["one"].downstream.shape[2] == 0
    w = sampler(data).sample(0, 6)
    assert w.down_given.shape == (6, 12, 0, T)
    assert not w.near_exists.any()


def test_episodes_must_have_something(tmp_path):
    data = made_up_dataset(tmp_path / "a", {"one": grid_network(1, 1)})
    manifest = data.path / MANIFEST
    manifest.write_text(re.sub(r'"cells": ?1', '"cells": 0', manifest.read_text()))
    with pytest.raises(UserError, match="must have something recorded"):
        sampler(read_dataset(data.path))


def test_episodes_must_be_long_enough(tmp_path):
    short = made_up_dataset(tmp_path / "a", {"one": grid_network(1, 1)}, episodes=1, steps=7)
    with pytest.raises(UserError, match="at least 8 steps"):
        sampler(short)


def test_a_changed_episode_is_refused(tmp_path):
    data = made_up_dataset(tmp_path / "a", {"one": grid_network(1, 1)}, episodes=2)
    path = data.path / EPISODES / "00001.parquet"
    path.write_bytes(path.read_bytes() + b"x")
    with pytest.raises(UserError, match="checksum"):
        sampler(data).sample(0, 2)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [('"format": 1', '"format": 9', "has format 9"), ('"git"', '"gut"', "gut"), ("{", "", "JSON")],
)
def test_no_dataset(tmp_path, old, new, words):
    data = made_up_dataset(tmp_path / "a", {"one": grid_network(1, 1)}, episodes=1)
    manifest = data.path / MANIFEST
    manifest.write_text(manifest.read_text().replace(old, new, 1))
    with pytest.raises(UserError, match=words):
        read_dataset(data.path)
    with pytest.raises(UserError, match="no dataset"):
        read_dataset(tmp_path)
    with pytest.raises(UserError, match="no such folder"):
        read_dataset(tmp_path / "b")


def test_another_network_is_refused(tmp_path):
    data = made_up_dataset(tmp_path / "a", {"one": grid_network(1, 1)}, episodes=1)
    file = data.path / "networks" / "one.json"
    file.write_text(file.read_text().replace("n_1_1", "n_1_9"))
    with pytest.raises(UserError, match="another network"):
        sampler(data)


def test_draws_only_intersections_with_sensors(dataset):
    made = sampler(dataset)
    made.sample(0, 1)
    made._pool.sensed = [np.array([1])] * made._pool.size
    assert isinstance(made.draw(5, np.random.default_rng(0)), Draw)
    assert set(made.draw(50, np.random.default_rng(0)).intersection) == {1}
