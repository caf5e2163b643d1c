import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.networks import grid_network, sharing_lanes, tee_network
from tsc_missing.config import MissingSettings
from tsc_missing.errors import UserError
from tsc_missing.evaluation.scenario import find_scenario
from tsc_missing.sensing.masks import missing_share
from tsc_missing.sensing.patterns import PATTERNS, draw_mask, equipped

GRID = grid_network(3, 4)
LONG = grid_network(6, 3)
TEE = tee_network()
SEEDS = st.integers(0, 2**31)
GREEDY = 3  # non-adjacent intersections that any greedy order finds on a 3 x 4 grid


def draw(pattern, rate, network=GRID, steps=60, seed=0, **settings):
    rate = 0.0 if pattern == "none" else rate
    return draw_mask(MissingSettings(pattern=pattern, rate=rate, **settings), network, steps, seed)


def blind(rate, network=GRID, seed=0, **settings):
    mask = draw("kriging", rate, network, 3, seed, **settings)
    dark = ~mask.any(axis=(0, 2))
    assert (mask == ~dark[:, None]).all()
    return set(np.flatnonzero(dark).tolist())


def adjacent_pairs(nodes, network=GRID):
    rows = sorted(nodes)
    return int(network.adjacency[np.ix_(rows, rows)].sum()) // 2


def test_every_pattern_of_the_settings_is_registered():
    names = MissingSettings.model_fields["pattern"].annotation.__args__
    assert set(names) - {"file"} == set(PATTERNS)  # what is missing is read there, not drawn


@pytest.mark.parametrize("pattern", PATTERNS)
@given(seed=SEEDS, rate=st.floats(0, 0.25))
def test_shape_determinism_and_absent_slots(pattern, seed, rate):
    network = TEE if pattern != "kriging" else GRID
    mask = draw(pattern, rate, network, 20, seed)
    assert mask.shape == (20, network.n, 12)
    assert mask.dtype == np.bool_
    assert (mask == draw(pattern, rate, network, 20, seed)).all()
    assert (draw(pattern, rate, network, 31, seed)[:20] == mask).all()
    assert mask[:, ~network.slot_mask].all()
    mask[:] = False  # owns its memory


@pytest.mark.parametrize("pattern", sorted(set(PATTERNS) - {"none"}))
def test_seeds_differ(pattern):
    masks = [draw(pattern, 0.25, seed=seed) for seed in range(5)]
    assert any((masks[0] != mask).any() for mask in masks[1:])


@pytest.mark.parametrize("pattern", PATTERNS)
def test_rate_zero_misses_nothing(pattern):
    assert draw(pattern, 0.0).all()


@pytest.mark.parametrize("pattern", ["random", "lane", "burst", "mixed"])
def test_rate_one_misses_all_that_is_there(pattern):
    assert missing_share(draw(pattern, 1.0, TEE), TEE.slot_mask) == 1


@pytest.mark.parametrize("pattern", ["random", "lane", "burst", "mixed"])
@pytest.mark.parametrize("rate", [0.1, 0.3, 0.5, 0.7])
@pytest.mark.parametrize("network", [GRID, TEE], ids=["grid", "tee"])
def test_share_is_the_rate(pattern, rate, network):
    shares = [
        missing_share(draw(pattern, rate, network, 2000, seed), network.slot_mask)
        for seed in range(3)
    ]
    assert np.mean(shares) == pytest.approx(rate, abs=0.02)


def test_random_misses_whole_intersections_independently():
    mask = draw("random", 0.5, steps=4000)
    assert (mask == mask[:, :, :1]).all()
    seen = mask[:, :, 0].astype(float)
    between = np.corrcoef(seen.T) - np.eye(GRID.n)
    after = [np.corrcoef(seen[1:, n], seen[:-1, n])[0, 1] for n in range(GRID.n)]
    assert np.abs(between).max() < 0.1
    assert np.abs(after).max() < 0.1


def test_lane_misses_single_slots():
    mask = draw("lane", 0.5, steps=4000)
    assert np.abs(np.corrcoef(mask[:, 0].T.astype(float)) - np.eye(12)).max() < 0.1


@pytest.mark.parametrize("pattern", ["lane", "mixed"])
def test_movements_on_one_lane_are_silent_together(pattern):
    mask = draw(pattern, 0.5, sharing_lanes(GRID), steps=400)
    left, straight, right = (mask[:, :, turn::3] for turn in range(3))
    assert (straight == right).all()
    assert 0.2 < (left != straight).mean() < 0.6
    assert (left == draw(pattern, 0.5, GRID, steps=400)[:, :, 0::3]).all()


def sensors(network):
    """The slots (N, 12) that each sensor of the network is of."""
    there = [*zip(*np.nonzero(network.slot_mask), strict=True)]
    firsts = {(n, network.slots_in_common[n, slot]) for n, slot in there}
    numbers = np.arange(network.n)[:, None]
    return [
        (network.slots_in_common == first) & (numbers == n) & network.slot_mask
        for n, first in firsts
    ]


@pytest.mark.parametrize("network", [GRID, TEE, sharing_lanes(GRID)], ids=["grid", "tee", "shared"])
@given(seed=SEEDS, rate=st.floats(0, 1), more=st.floats(0, 1))
def test_lasting_faults_are_a_share_of_the_sensors(network, seed, rate, more):
    found = sensors(network)
    mask = draw("lane", rate, network, 5, seed, lasting=True)
    assert (mask == mask[:1]).all()
    assert all(len(np.unique(mask[0, slots])) == 1 for slots in found)
    broken = sum(not mask[0, slots].any() for slots in found)
    assert broken == max(math.floor(round(rate * len(found), 9) + 0.5), rate > 0)
    assert mask[:, ~network.slot_mask].all()
    fewer = draw("lane", rate * more, network, 5, seed, lasting=True)
    assert (fewer >= mask).all()
    missing = MissingSettings(pattern="lane", rate=rate, lasting=True)
    assert (equipped(missing, network, seed) == mask[0]).all()


def test_lasting_faults_are_of_the_lane_pattern():
    assert missing_share(draw("lane", 0.25, lasting=True), GRID.slot_mask) == 0.25
    for pattern in sorted(set(PATTERNS) - {"lane"}):
        with pytest.raises(ValueError, match="lasting goes with the pattern lane only"):
            draw(pattern, 0.25, lasting=True)


@given(seed=SEEDS, rate=st.floats(0, 0.25))
def test_kriging_share_and_no_two_adjacent(seed, rate):
    nodes = blind(rate, seed=seed)
    exact = rate * GRID.n
    assert len(nodes) == pytest.approx(exact, abs=0.5 + 1e-6) or (len(nodes) == 1 and exact < 1)
    assert bool(nodes) == (rate > 0)
    assert adjacent_pairs(nodes) == 0


@pytest.mark.parametrize(
    ("rate", "n", "count"),
    [(0.0625, 4, 1), (0.25, 6, 5), (0.0833, 4, 1), (0.1, 5, 2), (0.01, 4, 1)],
)
def test_kriging_rounds_half_up_and_blinds_at_least_one(rate, n, count):
    assert len(blind(rate, grid_network(3, n))) == count


@given(seed=SEEDS)
def test_kriging_sets_of_a_seed_are_nested(seed):
    sets = [blind(k / GRID.n, seed=seed) for k in range(GREEDY + 1)]
    assert [len(nodes) for nodes in sets] == list(range(GREEDY + 1))
    assert all(small < large for small, large in pairwise(sets))


PAPER_KRIGING = {  # the paper's numbers of blind intersections
    "hangzhou_1": range(1, 5),
    "jinan_1": range(1, 4),
    "newyork_1": (3, 6, 9, 12),
}


@pytest.mark.parametrize("net", PAPER_KRIGING)
def test_kriging_sets_of_the_papers_rates_are_nested(net):
    network = find_scenario(net, "profile").folder.network
    for seed in range(30):
        sets = [blind(round(k / network.n, 4), network, seed) for k in PAPER_KRIGING[net]]
        assert [len(nodes) for nodes in sets] == list(PAPER_KRIGING[net])
        assert all(small < large for small, large in pairwise(sets))
        assert adjacent_pairs(sets[-1], network) == 0


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("count", [4, 5, 6])
def test_kriging_finds_sets_that_a_greedy_order_misses(seed, count):
    nodes = blind(count / GRID.n, seed=seed)
    assert len(nodes) == count
    assert adjacent_pairs(nodes) == 0


def test_kriging_largest_sets_vary_with_the_seed():
    assert len({frozenset(blind(0.5, seed=seed)) for seed in range(10)}) > 1


def test_kriging_error_names_the_true_maximum():
    with pytest.raises(UserError, match=r"rate: 0\.6 .* at most 9 of the 18 .*\(rate 0\.5\)"):
        blind(0.6, LONG)
    assert len(blind(0.5, LONG)) == 9


@given(seed=SEEDS, rate=st.floats(0.25, 1))
def test_kriging_adjacent_surrounds_one(seed, rate):
    nodes = blind(rate, seed=seed, adjacent=True)
    assert len(nodes) == math.floor(rate * GRID.n + 0.5)
    rings = [{node, *np.flatnonzero(GRID.adjacency[node]).tolist()} for node in nodes]
    assert any(ring <= nodes for ring in rings)


@pytest.mark.parametrize("seed", range(20))
def test_kriging_adjacent_draws_the_others_apart(seed):
    nodes = blind(5 / 18, LONG, seed, adjacent=True)
    rings = [{node, *np.flatnonzero(LONG.adjacency[node]).tolist()} for node in nodes]
    whole = [ring for ring in rings if ring <= nodes]
    assert any(
        adjacent_pairs(nodes, LONG) == adjacent_pairs(ring, LONG) == len(ring) - 1 for ring in whole
    )


def test_kriging_adjacent_error_names_the_smallest_rate():
    with pytest.raises(UserError, match=r"rate: 0\.1 .* at least 3 of the 12 .*\(rate 0\.25\)"):
        blind(0.1, adjacent=True)
    assert blind(0.0, adjacent=True) == set()
    assert len(blind(0.25, adjacent=True)) == 3


def outage_lengths(out):
    """The lengths of the outages in (T, N) that begin and end inside."""
    lengths = []
    for column in out.T.astype(int):
        steps = np.diff(column)
        starts, ends = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)
        ends = ends[ends > starts[0]]
        lengths += (ends - starts[: len(ends)]).tolist()
    return lengths


@pytest.mark.parametrize("mean", [1.0, 4.0, 8.0])
def test_burst_outages_have_the_mean_length(mean):
    out = ~draw("burst", 0.4, steps=5000, mean_outage=mean)
    assert (out == out[:, :, :1]).all()
    assert np.mean(outage_lengths(out[:, :, 0])) == pytest.approx(mean, rel=0.06)


def test_burst_starts_in_its_stationary_state():
    first = [~draw("burst", 0.3, steps=1, seed=seed)[0, :, 0] for seed in range(300)]
    assert np.mean(first) == pytest.approx(0.3, abs=0.03)


@pytest.mark.parametrize(("pattern", "most"), [("burst", 0.8888), ("mixed", 0.9876)])
def test_too_dense_outages_name_what_is_possible(pattern, most):
    with pytest.raises(UserError, match=f"rate: 0.99 .* mean_outage 8 .* {most}, or 1") as caught:
        draw(pattern, 0.99)
    assert caught.value.field == "rate"
    assert not draw(pattern, most).all()
    assert not draw(pattern, 0.99, mean_outage=1000).all()


@given(seed=SEEDS, rate=st.floats(0, 0.98))
def test_mixed_blinds_at_most_a_third(seed, rate):
    mask = draw("mixed", rate, TEE, 200, seed)
    dark = set(np.flatnonzero(~(mask & TEE.slot_mask).any(axis=(0, 2))).tolist())
    if rate < 0.6:  # a slot is not missing for 200 steps by chance
        share = TEE.slot_mask[sorted(dark)].sum() / TEE.slot_mask.sum()
        assert share <= rate / 3 + 1e-6
        assert adjacent_pairs(dark, TEE) == 0


def test_mixed_has_all_three_kinds():
    mask = draw("mixed", 0.5, steps=1000)
    dark = ~mask.any(axis=(0, 2))
    assert dark.sum() == 2
    seen = mask[:, ~dark]
    whole = ~seen.any(axis=2)
    assert np.mean(whole) == pytest.approx(1 - math.sqrt(0.5 / (1 - 2 / 12)), abs=0.03)
    assert np.mean(~seen[~whole]) == pytest.approx(1 - math.sqrt(0.5 / (1 - 2 / 12)), abs=0.03)


def test_a_single_intersection_can_be_blind():
    single = grid_network(1, 1)
    assert blind(1.0, single) == blind(1.0, single, adjacent=True) == {0}


@pytest.mark.parametrize("pattern", PATTERNS)
@given(seed=SEEDS, rate=st.floats(0, 0.25), tee=st.booleans())
def test_the_inventory_is_what_reports_in_the_long_run(pattern, seed, rate, tee):
    network = TEE if tee and pattern != "kriging" else GRID
    missing = MissingSettings(pattern=pattern, rate=0.0 if pattern == "none" else rate)
    inventory = equipped(missing, network, seed)
    np.testing.assert_array_equal(inventory, draw_mask(missing, network, 500, seed).any(axis=0))
    assert (inventory >= draw_mask(missing, network, 1, seed)[0]).all()


@pytest.mark.parametrize("pattern", sorted(set(PATTERNS) - {"none", "kriging"}))
def test_where_all_is_missing_there_is_no_sensor(pattern):
    inventory = equipped(MissingSettings(pattern=pattern, rate=1.0), TEE, 0)
    np.testing.assert_array_equal(inventory, ~TEE.slot_mask)
