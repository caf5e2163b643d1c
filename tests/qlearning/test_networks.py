from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch", reason="Q-networks need torch")

import torch
from hypothesis import given
from hypothesis import strategies as st

from tests.controllers.helpers import context
from tests.networks import grid_network, tee_network
from tsc_missing.controllers.advanced_max_pressure import share_in_reach
from tsc_missing.qlearning.controller import PhaseValues, QPolicy
from tsc_missing.qlearning.features import (
    N_NAMES,
    NAMES,
    SlotTables,
    certainty_features,
    columns,
    log_features,
    names_with,
    slot_features,
)
from tsc_missing.qlearning.networks import ALGORITHMS, NO_PHASE, Graph, PhaseValue

NETWORKS = {"2 x 3": grid_network(2, 3), "tee": tee_network()}


def observed(network, seed=0, steps=()):
    rng = np.random.default_rng(seed)
    shape = (*steps, network.n, 12)
    vehicles = rng.integers(0, 30, shape) * network.slot_mask
    queue = np.minimum(rng.integers(0, 30, shape), vehicles)
    return np.stack((vehicles, queue), axis=-1).astype(float), rng.integers(0, 5, shape)


def features(network, *args, **options):
    return slot_features(SlotTables.of(network, 15.0), *observed(network, *args, **options))


@pytest.mark.parametrize("network", NETWORKS.values(), ids=NETWORKS)
def test_features_follow_the_connections(network):
    values, red = observed(network)
    found = features(network)
    assert found.shape == (network.n, 12, N_NAMES)
    queue = values[..., 1].ravel()
    for n in range(network.n):
        for slot in range(12):
            for k, flat in enumerate(network.neighbours[n, slot]):
                there = found[n, slot, NAMES.index(f"upstream_there_{k}")]
                wanted = queue[flat] if flat >= 0 else 0
                assert there == (flat >= 0)
                got = found[n, slot, NAMES.index(f"upstream_queue_{k}")]
                assert got == pytest.approx(wanted / 10)
            down = [queue[flat] for flat in network.downstream[n, slot] if flat >= 0]
            lanes = max(network.exit_lane_count[n, slot], 1)
            got = found[n, slot, NAMES.index("downstream_queue")]
            assert got == pytest.approx(sum(down) / lanes / 10, rel=1e-5)
    assert (found[..., NAMES.index("green")] == (red == 0)).all()


def test_features_of_many_steps_are_those_of_each():
    network = NETWORKS["tee"]
    values, red = observed(network, steps=(4,))
    tables = SlotTables.of(network, 15.0)
    together = slot_features(tables, values, red)
    for t in range(4):
        assert (together[t] == slot_features(tables, values[t], red[t])).all()


def test_the_past_is_that_of_the_steps_before():
    network, names = NETWORKS["tee"], names_with(2)
    values, red = observed(network, steps=(4,))
    found = log_features(SlotTables.of(network, 15.0), values, red, 2)
    assert found.shape == (4, network.n, 12, len(names))
    for name in ("queue", "running", "green"):
        now = found[..., names.index(name)]
        for ago in (1, 2):
            before = found[..., names.index(f"{name}_{ago}_ago")]
            assert (before[ago:] == now[:-ago]).all()
            assert (before[:ago] == now[0]).all()  # before the first step it was as in the first


def test_looking_further_back_changes_nothing_by_itself():
    network = NETWORKS["tee"]
    x = torch.from_numpy(
        log_features(SlotTables.of(network, 15.0), *observed(network, steps=(6,)), 4)
    )
    short, long, graph = PhaseValue(8, 1), PhaseValue(8, 4), Graph.of(network)
    long.load_state_dict(short.seeing_more(4))
    assert torch.equal(long(x, graph), short(x[..., : len(names_with(1))], graph))


def test_what_was_filled_in_can_be_told():
    network, rng = NETWORKS["tee"], np.random.default_rng(0)
    known = rng.random((5, network.n, 12)) < 0.4
    found = certainty_features(known)
    assert found.shape == (network.n, 12, 2)
    assert (found[..., 0] == known[-1]).all()
    for n in range(network.n):
        for slot in range(12):
            ago = [k for k in range(5) if known[4 - k, n, slot]]
            assert found[n, slot, 1] == pytest.approx((ago[0] if ago else 5) / 5)


def test_a_short_detector_sees_who_is_near_only():
    network = NETWORKS["tee"]
    near = SlotTables.of(network, 15.0, 50.0)
    np.testing.assert_array_equal(near.in_reach, share_in_reach(network, 15.0, 50.0))
    q = PhaseValue(8, 1)
    given = replace(context(network), detector_length=50.0)
    for made in (PhaseValues.for_run(q, given), QPolicy(q, "q")):
        if isinstance(made, QPolicy):
            made.reset(given)
            made = made._values
        np.testing.assert_array_equal(made._tables.in_reach, near.in_reach)


def test_being_told_changes_nothing_by_itself_and_then_counts():
    network = NETWORKS["tee"]
    values, red = observed(network, steps=(5,))
    short, told = PhaseValue(8, 1), PhaseValue(8, 4, certainty=True)
    told.load_state_dict(short.seeing_more(4, certainty=True))
    told.load_state_dict(told.seeing_more(4, certainty=True))
    nothing = np.zeros(red.shape, dtype=bool)
    of = [PhaseValues(q, network, 15).of for q in (short, told)]
    there = network.phase_mask
    plain = of[0](values, red)[there]
    for found in (of[1](values, red), of[1](values, red, nothing)):
        np.testing.assert_allclose(found[there], plain, rtol=1e-4, atol=1e-5)
    with torch.no_grad():
        weight = told.slot.layers[0].weight
        weight.add_(0.1 * torch.randn(weight.shape))
    assert (of[1](values, red)[there] != of[1](values, red, nothing)[there]).any()
    for history, certainty in ((3, True), (4, False)):
        with pytest.raises(ValueError, match="looks back 4"):
            told.seeing_more(history, certainty)


def test_columns_are_by_name():
    assert columns(["green"]) == [NAMES.index("green")]
    assert columns(NAMES) == list(range(N_NAMES))


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("network", NETWORKS.values(), ids=NETWORKS)
def test_values_of_phases_that_are_there(algorithm, network):
    torch.manual_seed(0)
    q, graph = ALGORITHMS[algorithm](8), Graph.of(network)
    values = q(torch.from_numpy(features(network, steps=(3,))), graph)
    assert values.shape == (3, *network.phase_mask.shape)
    there = graph.phase_mask.expand(3, -1, -1)
    assert values[there].isfinite().all()
    assert (values[~there] == NO_PHASE).all()
    values[there].sum().backward()
    for name, weight in q.named_parameters():
        assert weight.grad.isfinite().all(), name


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@given(order=st.permutations(range(6)))
def test_permuting_intersections_permutes_the_values(algorithm, order):
    torch.manual_seed(0)
    network = NETWORKS["2 x 3"]
    q, graph, x = ALGORITHMS[algorithm](8), Graph.of(network), torch.from_numpy(features(network))
    place = np.argsort(order)
    adjacent = graph.adjacent[list(order)]
    moved = torch.where(adjacent >= 0, torch.from_numpy(place)[adjacent.clamp(min=0)], -1)
    other = Graph(graph.phases[list(order)], graph.phase_mask[list(order)], moved)
    plain, permuted = q(x[None], graph)[0], q(x[list(order)][None], other)[0]
    torch.testing.assert_close(permuted, plain[list(order)], rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_order_of_phases_does_not_matter(algorithm):
    torch.manual_seed(0)
    network = NETWORKS["2 x 3"]
    q, graph, x = ALGORITHMS[algorithm](8), Graph.of(network), torch.from_numpy(features(network))
    order = [2, 0, 3, 1]
    other = Graph(graph.phases[:, order], graph.phase_mask[:, order], graph.adjacent)
    torch.testing.assert_close(q(x[None], other), q(x[None], graph)[..., order])
