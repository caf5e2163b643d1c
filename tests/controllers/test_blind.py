import numpy as np
import pytest

from tests.controllers.helpers import A, B, Scripted, context, cross_and_tee, observe, with_holes
from tests.networks import grid_network, tee_network
from tsc_missing.controllers.blind import Blind, learned_kind
from tsc_missing.controllers.fixed_time import PlainCycle

INNER = np.array([3, 2])


@pytest.fixture
def network():
    return cross_and_tee()


def run(blind, network, holes_at, **known):
    """(T, N): the phases; ``holes_at[t]`` lists the intersections that report nothing at t."""
    blind.reset(context(network, **known))
    answers = []
    for step, dark in enumerate(holes_at):
        holes = np.zeros((2, 12), dtype=bool)
        holes[dark] = network.slot_mask[dark]
        answers.append(blind.decide(with_holes(observe(network, step=step), holes)))
    return np.array(answers)


def test_an_intersection_without_sensors_follows_the_cycle_from_the_start(network):
    sensors = np.ones((2, 12), dtype=bool)
    sensors[B] = ~network.slot_mask[B]  # absent slots count as reported
    phases = run(Blind(Scripted(INNER), PlainCycle(15.0)), network, [[B]] * 5, sensors=sensors)
    assert phases[:, A].tolist() == [3] * 5
    assert phases[:, B].tolist() == [0, 1, 2, 0, 1]


def test_an_outage_is_bridged_and_then_enters_the_cycle_where_it_stands(network):
    dark = [[], [A], [A], [A], [A], [A], [], [A]]
    phases = run(Blind(Scripted(INNER), PlainCycle(15.0), stale_steps=2), network, dark)
    #                           seen, 1, 2 silent, then steps 3, 4, 5 of the cycle, seen, 1 silent
    assert phases[:, A].tolist() == [3, 3, 3, 3, 0, 1, 3, 3]
    assert phases[:, B].tolist() == [2] * 8


def test_one_slot_that_reports_is_enough(network):
    blind = Blind(Scripted(INNER), PlainCycle(15.0), stale_steps=0)
    blind.reset(context(network))
    holes = network.slot_mask.copy()
    holes[A, 4] = False
    phases = blind.decide(with_holes(observe(network, step=1), holes))
    assert phases.tolist() == [3, 1]


def test_the_inner_controller_is_asked_at_every_step_and_reset(network):
    inner = Scripted(INNER)
    run(Blind(inner, PlainCycle(15.0), stale_steps=0), network, [[A, B]] * 4)
    assert (inner.resets, inner.asked) == (1, 4)


def test_reset_forgets_silence(network):
    blind = Blind(Scripted(INNER), PlainCycle(15.0), stale_steps=2)
    run(blind, network, [[A]] * 3)
    assert run(blind, network, [[A]] * 2)[:, A].tolist() == [3, 3]


def test_estimates_pass_through(network):
    inner = Scripted(INNER)
    inner.estimate = np.ones((2, 12, 2))
    assert Blind(inner, PlainCycle(15.0)).estimates() is inner.estimate


def test_clustered_only_where_a_neighbour_is_blind_too(network):
    blind = Blind(Scripted(INNER), PlainCycle(15.0), stale_steps=0, clustered=True)
    phases = run(blind, network, [[B], [A, B], [A]])
    assert phases[:, A].tolist() == [3, 1, 3]
    assert phases[:, B].tolist() == [2, 1, 2]


def test_clustered_leaves_a_blind_intersection_that_sees_all_around_it():
    network = grid_network(1, 4)
    row = chain(network)
    holes = network.slot_mask.copy()
    holes[row[2]] = False
    blind = Blind(Scripted(np.full(4, 3)), PlainCycle(15.0), stale_steps=0, clustered=True)
    blind.reset(context(network))
    phases = blind.decide(with_holes(observe(network), holes))
    assert phases[row].tolist() == [0, 0, 3, 3]


def test_familiar_leaves_what_the_weights_never_saw():
    tee = tee_network()
    sides = tee.slot_mask.reshape(tee.n, 4, 3).any(axis=2).sum(axis=1)
    assert sorted(sides) == [3, 4, 4, 4, 4, 4]
    assert learned_kind(tee).tolist() == (sides == 4).tolist()
    for dark in range(tee.n):
        blind = Blind(Scripted(np.full(tee.n, 2)), PlainCycle(15.0), stale_steps=0, familiar=True)
        blind.reset(context(tee))
        holes = np.zeros_like(tee.slot_mask)
        holes[dark] = tee.slot_mask[dark]
        expected = np.full(tee.n, 2)
        expected[dark] = 2 if sides[dark] == 4 else 0
        assert blind.decide(with_holes(observe(tee), holes)).tolist() == expected.tolist()


def test_movements_that_share_a_lane_are_not_of_the_learned_kind(network, monkeypatch):
    assert learned_kind(network)[A]
    shared = network.shares_lanes.copy()
    shared[A, 4:6] = True
    monkeypatch.setitem(vars(network), "shares_lanes", shared)
    assert not learned_kind(network)[A]


def chain(network):
    """The intersections of a row from one end to the other."""
    ends = [n for n in range(network.n) if network.adjacency[n].sum() == 1]
    order = [ends[0]]
    while len(order) < network.n:
        order += [n for n in np.flatnonzero(network.adjacency[order[-1]]) if n not in order]
    return order


def test_an_intersection_that_has_no_neighbours_is_not_of_the_learned_kind():
    network = grid_network(1, 1)
    blind = Blind(Scripted(np.array([3])), PlainCycle(15.0), familiar=True)
    blind.reset(context(network, sensors=~network.slot_mask))
    assert blind.decide(observe(network)).tolist() == [0]


@pytest.mark.parametrize("build", [cross_and_tee, lambda: grid_network(1, 1)])
def test_alone_leaves_only_who_has_no_neighbour(build):
    network = build()
    phases = np.full(network.n, 2)
    blind = Blind(Scripted(phases), PlainCycle(15.0), alone=True)
    blind.reset(context(network, sensors=~network.slot_mask))
    expected = [0] if network.n == 1 else [2, 2]
    assert blind.decide(observe(network)).tolist() == expected
