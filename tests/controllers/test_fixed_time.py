from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.controllers.helpers import A, B, context, cross_and_tee, observe, slot
from tsc_missing.config import SignalSettings
from tsc_missing.controllers.fixed_time import (
    SATURATION_FLOW,
    FixedTime,
    PlainCycle,
    critical_ratios,
    slot_flow_ratios,
    split_steps,
    webster_cycle,
    webster_plan,
)
from tsc_missing.network.model import Network
from tsc_missing.simulation.signals import Signals

FLOWS = {
    (A, "E-straight"): 0.3 * SATURATION_FLOW,
    (A, "W-straight"): 0.25 * SATURATION_FLOW,
    (A, "N-straight"): 0.2 * SATURATION_FLOW,
    (A, "S-straight"): 0.1 * SATURATION_FLOW,
    (A, "W-left"): 0.1 * SATURATION_FLOW,
    (B, "W-straight"): 0.56 * SATURATION_FLOW,  # on two lanes
    (B, "E-straight"): 0.18 * SATURATION_FLOW,  # on one lane with E-left
    (B, "E-left"): 0.1 * SATURATION_FLOW,
    (B, "S-left"): 0.1 * SATURATION_FLOW,
}


@pytest.fixture
def network():
    return cross_and_tee()


def phases(controller, network, steps, **known):
    controller.reset(context(network, **known))
    return np.array([controller.decide(observe(network, step=step)) for step in steps])


def test_flow_ratio_of_several_lanes_and_of_a_shared_lane(network):
    ratios = slot_flow_ratios(network, context(network, flows=FLOWS).turning_flows)
    assert ratios[B, slot("W-straight")] == pytest.approx(0.28)
    assert ratios[B, slot("E-straight")] == ratios[B, slot("E-left")] == pytest.approx(0.28)
    assert ratios[A, slot("E-straight")] == pytest.approx(0.3)
    assert (ratios[~network.slot_mask] == 0).all()


def test_critical_ratio_is_the_largest_and_phases_share_a_slot_that_several_serve(network):
    ratios = critical_ratios(network, context(network, flows=FLOWS).turning_flows)
    np.testing.assert_allclose(ratios, [[0.3, 0.2, 0.1, 0], [0.28, 0.28, 0.1, 0]], atol=1e-12)


@pytest.mark.parametrize(
    ("ratio", "lost", "seconds"),
    [
        (0.6, 20.0, 87.5),
        (0.5, 20.0, 70.0),
        (0.0, 20.0, 60.0),
        (0.9, 20.0, 180.0),
        (1.4, 20.0, 180.0),
    ],
)
def test_webster_cycle(ratio, lost, seconds):
    assert webster_cycle(ratio, lost) == pytest.approx(seconds)


def test_split_goes_to_the_phase_that_is_worst_off():
    # greens of 10, 25, 40 s: 0.30 / 25 = 0.012 < 0.20 / 10 = 0.020, then 0.30 / 25 > 0.20 / 25
    ratios = np.array([0.3, 0.2, 0.1])
    splits = [split_steps(ratios, 5.0, 15.0, total).tolist() for total in (3, 4, 5, 6, 7)]
    assert splits == [[1, 1, 1], [2, 1, 1], [2, 2, 1], [3, 2, 1], [3, 2, 2]]


def test_webster_plan_by_hand_without_need_to_lengthen():
    # Y = 0.4, L = 15, C = 27.5 / 0.6 = 45.8 -> 60 s, 4 steps, greens 25, 10, 10 s
    # x = 0.2 * 60 / 25 = 0.48, 0.1 * 60 / 10 = 0.6, 0.6
    assert webster_plan(np.array([0.2, 0.1, 0.1]), 5.0, 15.0).tolist() == [2, 1, 1]


def test_webster_plan_by_hand_lengthened_for_the_sake_of_whole_steps(network):
    # A: Y = 0.6, L = 20, C = 87.5 s, 6 steps: greens 25, 25, 10, 10 s, x = 0.3 * 90 / 25 = 1.08
    #    7 steps: third phase 0.1 * 105 / 10 = 1.05; 8: second 0.2 * 120 / 25 = 0.96
    #    9: first 0.3 * 135 / 40 = 1.01; 10: greens 55, 40, 25, 10 s, x = 0.82, 0.75, 0.6
    # B: Y = 0.66, L = 15, C = 80.9 s, 5 steps: greens 25, 25, 10 s, x = 0.84, 0.84, 0.75
    plan = FixedTime().plan(context(network, flows=FLOWS))
    assert plan.tolist() == [[4, 3, 2, 1], [2, 2, 1, 0]]


def test_fixed_time_repeats_its_plan_from_phase_0(network):
    run = phases(FixedTime(), network, range(12), flows=FLOWS)
    assert run[:, A].tolist() == [0, 0, 0, 0, 1, 1, 1, 2, 2, 3, 0, 0]
    assert run[:, B].tolist() == [0, 0, 1, 1, 2, 0, 0, 1, 1, 2, 0, 0]
    assert run.dtype == np.int64


def test_without_flow_phases_are_equal_and_the_cycle_is_the_shortest(network):
    assert FixedTime().plan(context(network)).tolist() == [[1, 1, 1, 1], [2, 1, 1, 0]]


def test_oversaturated_intersections_get_the_longest_cycle_and_every_phase_a_step(network):
    flows = {(A, "E-straight"): 5000.0, (B, "S-left"): 5000.0}
    plan = FixedTime().plan(context(network, flows=flows))
    assert plan.tolist() == [[9, 1, 1, 1], [1, 1, 10, 0]]


def test_long_decision_intervals_still_give_every_phase_a_step(network):
    plan = FixedTime().plan(context(network, interval=60.0))
    assert plan.tolist() == [[1, 1, 1, 1], [1, 1, 1, 0]]


def test_steps_that_no_flow_asks_for_are_spread():
    assert split_steps(np.zeros(3), 5.0, 15.0, 8).tolist() == [3, 3, 2]


def test_one_phase_loses_no_time():
    assert webster_plan(np.array([0.85]), 5.0, 15.0).tolist() == [4]


@pytest.mark.parametrize(
    ("seconds", "cross", "tee"),
    [
        (15.0, [0, 1, 2, 3, 0, 1, 2, 3], [0, 1, 2, 0, 1, 2, 0, 1]),
        (30.0, [0, 0, 1, 1, 2, 2, 3, 3], [0, 0, 1, 1, 2, 2, 0, 0]),
    ],
)
def test_plain_cycle(seconds, cross, tee, network):
    run = phases(PlainCycle(seconds), network, range(8))
    assert run.T.tolist() == [cross, tee]


def test_plain_cycle_counts_seconds_and_not_steps(network):
    run = phases(PlainCycle(30.0), network, range(6), interval=10.0)
    assert run[:, A].tolist() == [0, 0, 0, 1, 1, 1]


def test_a_cycle_depends_on_the_step_alone(network):
    assert phases(PlainCycle(15.0), network, [6, 1, 6])[:, A].tolist() == [2, 1, 2]


def test_lanes_for_buses_carry_no_cars(network):
    flows = np.zeros(network.slot_mask.shape)
    n, k = B, slot("W-straight")
    flows[n, k] = 0.5 * SATURATION_FLOW
    one, other = network.slot_lanes[n][k]
    assert slot_flow_ratios(network, flows)[n, k] == pytest.approx(0.25)
    for closed, share in (({one}, 0.5), ({one, other}, 0.25)):
        lanes = {
            name: lane.model_copy(update={"no_cars": True} if name in closed else {})
            for name, lane in network.record.lanes.items()
        }
        record = network.record.model_copy(update={"lanes": lanes})
        ratios = slot_flow_ratios(Network("buses", record), flows)
        assert ratios[n, k] == pytest.approx(share)


@given(
    yellow=st.integers(1, 6),
    all_red=st.integers(0, 3),
    green=st.integers(1, 20),
    min_green=st.integers(0, 45),
    controller=st.sampled_from([FixedTime(), PlainCycle(15), PlainCycle(30)]),
)
@settings(max_examples=60, deadline=None)
def test_no_phase_of_a_plan_waits_for_the_minimum_green(
    yellow, all_red, green, min_green, controller
):
    interval = yellow + all_red + green
    timing = SignalSettings(
        decision_interval=interval, yellow=yellow, all_red=all_red, min_green=min_green
    )
    network = cross_and_tee()
    least = {timing.min_steps_at(node) for node in network.intersections}
    assert len(least) == 1
    most = least.pop()
    known = context(network, flows=FLOWS, interval=float(interval), least=most)
    controller.reset(replace(known, lost_time=float(yellow + all_red)))
    signals = Signals(network, timing, lambda light, state: None)
    shown = []
    for step in range(60 + 4 * most):
        phases = controller.decide(observe(network, step=step))
        if signals.command(phases, step * interval):
            if all_red:
                signals.clear(step * interval + yellow)
            signals.release(step * interval + yellow + all_red)
        shown.append(signals.phase.copy())
    assert signals.held == 0
    for n, mask in enumerate(network.phase_mask):
        assert {phases[n] for phases in shown} == set(np.flatnonzero(mask))
