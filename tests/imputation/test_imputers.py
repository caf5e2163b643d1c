from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.networks import context_for, grid_network, tee_network
from tsc_missing.config import MissingSettings
from tsc_missing.errors import UserError
from tsc_missing.imputation.registry import IMPUTERS, make_imputer
from tsc_missing.imputation.store_and_forward import StoreAndForward, nearest_slots
from tsc_missing.network.model import Network
from tsc_missing.network.slots import LEFT, N_SLOTS, RIGHT, STRAIGHT, slot_index
from tsc_missing.sensing.observation import N_FEATURES, Measurement, apply_mask
from tsc_missing.sensing.patterns import draw_mask

GRID = grid_network(2, 3)
TEE = tee_network()
NETWORKS = {"grid": GRID, "tee": TEE, "single": grid_network(1, 1)}
N, E, S, W = range(4)
ALL = pytest.mark.parametrize("name", IMPUTERS)
NETS = pytest.mark.parametrize("net", NETWORKS)
PATTERNS = st.sampled_from(["random", "kriging", "lane", "burst", "mixed"])


def observe(network, values, mask, step=0, exits=None):
    """An observation of ``values`` (N, 12) in both features, the second halved."""
    there = np.where(network.slot_mask, values, 0.0)
    truth = Measurement(
        values=np.stack([there, there / 2], axis=-1),
        exits=np.zeros_like(there) if exits is None else exits,
    )
    phase = np.zeros(network.n, dtype=np.int64)
    red = np.zeros(there.shape, dtype=np.int64)
    return apply_mask(truth, mask | ~network.slot_mask, step, 15.0 * step, phase, red)


def run(name, network, values, masks, exits=None):
    imputer = make_imputer(name)
    imputer.reset(context_for(network))
    return [
        imputer.fill(observe(network, row, mask, t, None if exits is None else exits[t]))
        for t, (row, mask) in enumerate(zip(values, masks, strict=True))
    ]


def random_run(network, pattern, seed, steps=8):
    rng = np.random.default_rng(seed)
    values = rng.integers(0, 20, (steps, network.n, N_SLOTS)).astype(float)
    adjacent = pattern == "kriging"
    missing = MissingSettings(pattern=pattern, rate=0.5, adjacent=adjacent)
    return values, draw_mask(missing, network, steps, seed)


def flat(network, identity, approach, turn):
    return network.ids.index(identity) * N_SLOTS + slot_index(approach, turn)


def nothing(network):
    return ~network.slot_mask


def everything(network):
    return np.ones((network.n, N_SLOTS), dtype=bool)


@ALL
@NETS
@given(pattern=PATTERNS, seed=st.integers(0, 2**31))
def test_reported_values_stay_and_the_rest_is_finite(name, net, pattern, seed):
    network = NETWORKS[net]
    if network.n == 1 and pattern == "kriging":
        pattern = "lane"
    values, masks = random_run(network, pattern, seed)
    for t, filled in enumerate(run(name, network, values, masks, exits=values)):
        seen = masks[t]
        truth = np.where(network.slot_mask, values[t], 0.0)
        assert np.array_equal(filled.values[seen, 0], truth[seen])
        assert np.array_equal(filled.values[seen, 1], truth[seen] / 2)
        assert np.array_equal(filled.exits[seen], values[t][seen])
        assert np.isfinite(filled.values).all()
        assert np.isfinite(filled.exits).all()
        assert (filled.values[..., 0] <= values.max()).all()
        assert (filled.values >= 0).all()
        assert not filled.values[~network.slot_mask].any()
        assert np.allclose(filled.reward, -filled.values[..., 1].sum(axis=1))
        assert (filled.mask == (seen | ~network.slot_mask)).all()


@ALL
@given(
    pattern=PATTERNS, seed=st.integers(0, 2**31), poison=st.sampled_from([0.0, -7.0, 1e9, np.inf])
)
def test_what_is_under_the_mask_changes_nothing(name, pattern, seed, poison):
    values, masks = random_run(GRID, pattern, seed)
    other = make_imputer(name)
    other.reset(context_for(GRID))
    for t, filled in enumerate(run(name, GRID, values, masks, exits=values)):
        observation = observe(GRID, values[t], masks[t], t, values[t])
        poisoned = other.fill(
            replace(
                observation,
                values=np.where(masks[t][:, :, None], observation.values, poison),
                exits=np.where(masks[t], observation.exits, poison),
                reward=np.full(GRID.n, poison),
            )
        )
        assert np.array_equal(filled.values, poisoned.values)
        assert np.array_equal(filled.exits, poisoned.exits)


@ALL
def test_reset_forgets(name):
    values, masks = random_run(GRID, "lane", 3)
    imputer = make_imputer(name)
    results = []
    for _ in range(2):
        imputer.reset(context_for(GRID))
        results.append([imputer.fill(observe(GRID, *o)) for o in zip(values, masks, strict=True)])
    assert all(np.array_equal(a.values, b.values) for a, b in zip(*results, strict=True))


@ALL
def test_nothing_reported_yet_is_empty(name):
    first, second = run(name, TEE, np.full((2, TEE.n, 12), 9.0), [nothing(TEE)] * 2)
    assert not first.values.any()
    assert not second.values.any()
    assert not first.exits.any()


@ALL
def test_exits_keep_the_last_report(name):
    exits = np.arange(3 * GRID.n * 12, dtype=float).reshape(3, GRID.n, 12)
    masks = [everything(GRID), nothing(GRID), everything(GRID)]
    masks[0][2] = False
    filled = run(name, GRID, np.zeros((3, GRID.n, 12)), masks, exits)
    assert np.array_equal(filled[1].exits[3], exits[0, 3])
    assert not filled[1].exits[2].any()
    assert np.array_equal(filled[2].exits, exits[2])


def test_last_value_holds():
    values = np.stack([np.full((GRID.n, 12), v) for v in (4.0, 9.0, 2.0)])
    filled = run("last", GRID, values, [everything(GRID), nothing(GRID), nothing(GRID)])
    assert (filled[2].values[..., 0] == 4).all()


def test_last_value_without_history_takes_the_same_turn_now():
    turns = np.tile([1.0, 2.0, 3.0], 4)
    values = np.stack([np.tile(turns, (TEE.n, 1)), np.tile(turns * 10, (TEE.n, 1))])
    mask = everything(TEE)
    mask[0] = False
    filled = run("last", TEE, values, [mask, mask])
    assert np.array_equal(filled[0].values[0, :, 0], turns)
    assert np.array_equal(filled[1].values[0, :, 0], turns * 10)


def test_mean_is_of_what_was_reported():
    values = np.stack([np.full((GRID.n, 12), v) for v in (4.0, 9.0, 2.0, 50.0)])
    some = everything(GRID)
    some[1] = False
    filled = run("mean", GRID, values, [everything(GRID), some, everything(GRID), nothing(GRID)])
    assert (filled[1].values[1, :, 0] == 4).all()
    assert (filled[3].values[1, :, 0] == 3).all()
    assert (filled[3].values[0, :, 0] == 5).all()


def test_mean_without_history_takes_the_same_turn():
    turns = np.tile([1.0, 2.0, 3.0], 4)
    values = np.stack([np.tile(turns, (TEE.n, 1)), np.tile(turns * 3, (TEE.n, 1))])
    mask = everything(TEE)
    mask[0] = False
    filled = run("mean", TEE, values, [mask, mask])
    assert np.allclose(filled[1].values[0, :, 0], turns * 2)


def test_store_and_forward_takes_the_previous_step_of_the_nearest():
    rng = np.random.default_rng(5)
    values = rng.random((3, GRID.n, 12))
    mask = everything(GRID)
    mask[4] = False
    filled = run("sfm", GRID, values, [mask] * 3)
    table = nearest_slots(GRID, 12)
    assert not filled[0].values[4].any()
    for t in (1, 2):
        before = filled[t - 1].values.reshape(-1, N_FEATURES)
        for slot in range(12):
            row = table[4 * 12 + slot]
            reported = [near for near in row[row >= 0] if mask.flat[near]]
            assert np.allclose(filled[t].values[4, slot], before[reported].mean(axis=0))


def test_store_and_forward_takes_what_it_filled_where_nothing_reported():
    rng = np.random.default_rng(5)
    values = rng.random((4, GRID.n, 12))
    masks = [everything(GRID), nothing(GRID), nothing(GRID)]
    filled = run("sfm", GRID, values[:3], masks)
    before = filled[1].values.reshape(-1, N_FEATURES)
    for slot, row in enumerate(nearest_slots(GRID, 12)):
        expected = before[row[row >= 0]].mean(axis=0)
        assert np.allclose(filled[2].values.reshape(-1, N_FEATURES)[slot], expected)


def test_store_and_forward_counts_per_lane():
    """Twice the lanes hold twice the vehicles."""
    record = GRID.record.model_copy(deep=True)
    node = record.intersections[4]
    slot = slot_index(W, STRAIGHT)
    lane = next(link for link in node.links if link.slot == slot)
    second = lane.model_copy(update={"from_lane": lane.from_lane[:-1] + "9"})
    lanes = record.lanes | {second.from_lane: record.lanes[lane.from_lane]}
    nodes = list(record.intersections)
    nodes[4] = node.model_copy(update={"links": (*node.links, second)})
    wide = Network(
        "wide", record.model_copy(update={"intersections": tuple(nodes), "lanes": lanes})
    )
    values = np.full((2, GRID.n, 12), 3.0) * wide.slot_lane_count
    assert values[0, 4, slot] == 6
    filled = run("sfm", wide, values, [everything(wide), nothing(wide)])
    assert np.allclose(filled[1].values[..., 0], values[0])


@NETS
def test_nearest_slots_are_by_hops(net):
    """Against distances by repeated multiplication with the adjacency of slots."""
    network = NETWORKS[net]
    size = network.n * N_SLOTS
    linked = np.zeros((size, size), dtype=bool)
    for table in (network.neighbours, network.downstream):
        for slot, row in enumerate(table.reshape(size, -1)):
            linked[slot, row[row >= 0]] = True
    linked |= linked.T
    distance = np.where(np.eye(size, dtype=bool), 0, size)
    reached = np.eye(size, dtype=bool)
    for hops in range(1, 30):
        reached = reached @ linked
        distance = np.where(reached, np.minimum(distance, hops), distance)
    for slot, row in enumerate(nearest_slots(network, 12)):
        found = row[row >= 0]
        reachable = np.sort(distance[slot][distance[slot] < size])
        assert len(set(found)) == len(found)
        assert found[0] == slot
        assert distance[slot, found].tolist() == reachable[:12].tolist()
        if network.slot_mask.flat[slot]:
            assert network.slot_mask.flat[found].all()


def test_nearest_slots_of_a_straight_movement():
    """In the middle of a 3 x 3 grid, for traffic that comes from the west and goes east."""
    network = grid_network(3, 3)
    row = nearest_slots(network, 12)[flat(network, "n_2_2", W, STRAIGHT)].tolist()
    feeders = [("n_2_1", W, STRAIGHT), ("n_2_1", S, RIGHT), ("n_2_1", N, LEFT)]
    followers = [("n_2_3", W, turn) for turn in (LEFT, STRAIGHT, RIGHT)]
    assert row[0] == flat(network, "n_2_2", W, STRAIGHT)
    assert set(row[1:4]) == {flat(network, *slot) for slot in feeders}
    assert set(row[4:7]) == {flat(network, *slot) for slot in followers}


def test_corner_right_turn_keeps_its_own_value():
    corner = flat(GRID, "n_1_1", W, RIGHT)
    assert nearest_slots(GRID, 12)[corner].tolist() == [corner] + [-1] * 11
    values = np.arange(2 * GRID.n * 12, dtype=float).reshape(2, GRID.n, 12)
    filled = run("sfm", GRID, values, [everything(GRID), nothing(GRID)])
    assert filled[1].values.reshape(-1, N_FEATURES)[corner, 0] == values[0].flat[corner]


def test_registry():
    assert isinstance(make_imputer("sfm"), StoreAndForward)
    assert make_imputer("last") is not make_imputer("last")
    with pytest.raises(UserError, match=r"imputer: sfn .* did you mean sfm\? allowed: diff"):
        make_imputer("sfn")
