"""The rules that need complete values, against examples by hand."""

from dataclasses import replace

import numpy as np
import pytest

from tests.controllers.helpers import A, B, context, cross_and_tee, observe, slot, with_holes
from tsc_missing.controllers.advanced_max_pressure import AdvancedMaxPressure, share_in_reach
from tsc_missing.controllers.max_pressure import MaxPressure
from tsc_missing.controllers.max_queue import MaxQueue
from tsc_missing.controllers.scores import best_phases, downstream_mean, phase_scores

RULES = {
    "max-queue": MaxQueue,
    "max-pressure": MaxPressure,
    "advanced-max-pressure": AdvancedMaxPressure,
}


@pytest.fixture
def network():
    return cross_and_tee()


def decide(controller, network, **observed):
    controller.reset(context(network))
    return controller.decide(observe(network, **observed)).tolist()


def test_phase_scores_add_the_slots_of_a_phase_and_exclude_absent_phases(network):
    scores = np.zeros((2, 12))
    scores[A, [slot("E-straight"), slot("W-straight")]] = 2, 3
    scores[A, slot("N-right")] = 100  # free: in no phase
    scores[B, slot("E-straight")] = 4  # in two phases
    assert phase_scores(network, scores).tolist() == [[5, 0, 0, 0], [4, 4, 0, -np.inf]]


def test_ties_go_to_the_lowest_phase_in_spite_of_rounding_errors():
    scores = np.array([[0.3, 0.1 + 0.2, 0.0], [-1.0, 2.0, 2.0]])
    assert scores[0, 1] > scores[0, 0]
    assert best_phases(scores, "test").tolist() == [0, 1]


def test_downstream_mean_counts_links_to_the_next_signal_and_boundary_lanes(network):
    queue = np.zeros((2, 12))
    queue[B, [slot("W-straight"), slot("W-right")]] = 9, 3
    boundary = np.zeros((2, 12))
    boundary[A, slot("N-straight")] = 6
    mean = downstream_mean(network, queue, boundary)
    into_b = [slot("N-left"), slot("S-right"), slot("W-straight")]
    assert mean[A, into_b].tolist() == [4, 4, 4]  # three lanes lead to B
    assert mean[A, slot("N-straight")] == 2
    assert mean.sum() == 14


@pytest.mark.parametrize("rule", RULES.values())
def test_an_empty_network_gets_the_lowest_phase(rule, network):
    assert decide(rule(), network) == [0, 0]


@pytest.mark.parametrize("rule", RULES.values())
def test_phases_are_integers_of_the_right_shape(rule, network):
    controller = rule()
    controller.reset(context(network))
    phases = controller.decide(observe(network))
    assert phases.shape == (2,)
    assert phases.dtype == np.int64


@pytest.mark.parametrize(("name", "rule"), RULES.items())
def test_a_hole_where_a_value_is_needed_is_one_clear_error(name, rule, network):
    holes = np.zeros((2, 12), dtype=bool)
    holes[B, slot("S-left")] = True
    controller = rule()
    controller.reset(context(network))
    with pytest.raises(ValueError, match=f"{name} needs an imputer"):
        controller.decide(with_holes(observe(network), holes))


def test_max_queue_does_not_need_the_slots_that_no_phase_serves(network):
    holes = network.free_slots | ~network.slot_mask
    controller = MaxQueue()
    controller.reset(context(network))
    seen = with_holes(observe(network, queue={(A, "N-left"): 1, (B, "S-left"): 1}), holes)
    assert controller.decide(seen).tolist() == [3, 2]


def test_max_queue_takes_the_phase_with_the_largest_sum(network):
    queue = {
        (A, "E-straight"): 4,
        (A, "N-straight"): 3,
        (A, "S-straight"): 2,
        (A, "W-right"): 50,
        (B, "W-straight"): 2,
        (B, "E-straight"): 1,
        (B, "E-left"): 3,
    }
    assert decide(MaxQueue(), network, queue=queue) == [1, 1]  # 4 < 3 + 2; 2 + 1 < 1 + 3


def test_max_queue_looks_at_the_queue_and_not_at_the_vehicles(network):
    vehicles, queue = {(A, "N-left"): 20}, {(A, "W-left"): 1}
    assert decide(MaxQueue(), network, vehicles=vehicles, queue=queue)[A] == 2


@pytest.mark.parametrize(("leaving", "phase"), [(6, 1), (9, 0), (12, 0)])
def test_max_pressure_subtracts_the_mean_of_the_exit_lanes(leaving, phase, network):
    vehicles = {
        (A, "W-straight"): 6,  # 6 - (9 + 3) / 3 = 2
        (A, "N-straight"): 5,  # 5 - leaving / 3: 3, 2 (a tie), 1
        (B, "W-straight"): 9,
        (B, "W-right"): 3,
    }
    exits = {(A, "N-straight"): leaving}
    assert decide(MaxPressure(), network, vehicles=vehicles, exits=exits) == [phase, 0]


def test_max_pressure_never_takes_a_phase_that_is_not_there(network):
    full = {(B, name): 9 for name in ("E-left", "E-straight", "S-left", "W-straight")}
    exits = dict.fromkeys(full, 90)  # all pressures negative
    assert decide(MaxPressure(), network, vehicles=full, exits=exits)[B] == 2


@pytest.mark.parametrize(("queue", "phase"), [(4, 1), (5, 0)])
def test_advanced_max_pressure_keeps_green_while_demand_is_enough(queue, phase, network):
    # within 15 s a car at 10 m/s reaches the stop line from half of a lane of 300 m
    observed = {
        "vehicles": {(A, "N-straight"): 10, (A, "W-straight"): queue},
        "queue": {(A, "N-straight"): 2, (A, "W-straight"): queue},
        "phase": [1, 0],
    }
    assert decide(AdvancedMaxPressure(), network, **observed)[A] == phase


def test_advanced_max_pressure_without_a_current_phase_takes_the_largest_pressure(network):
    observed = {
        "vehicles": {(A, "N-straight"): 100, (A, "W-left"): 1},
        "queue": {(A, "W-left"): 1},
    }
    assert decide(AdvancedMaxPressure(), network, **observed)[A] == 2


def test_advanced_max_pressure_uses_means_over_lanes(network):
    queue = {(B, "W-straight"): 5, (B, "S-left"): 3}  # two lanes: 2.5 < 3
    assert decide(AdvancedMaxPressure(), network, queue=queue, vehicles=queue)[B] == 2


def test_advanced_max_pressure_subtracts_queues_behind_the_intersection(network):
    queue = {(A, "W-straight"): 3, (A, "N-straight"): 2, (B, "W-right"): 6}  # 3 - 6/3 < 2
    assert decide(AdvancedMaxPressure(), network, queue=queue, vehicles=queue)[A] == 1


def test_what_a_short_detector_counts_is_within_reach(network):
    whole = share_in_reach(network, 15.0)
    assert (whole[network.slot_mask] > 0).all()
    short = share_in_reach(network, 15.0, 50.0)
    assert (short[network.slot_mask] == 1).all()
    np.testing.assert_array_equal(share_in_reach(network, 15.0, 1e4), whole)
    reach = network.record.lanes[network.slot_lanes[A][slot("E-straight")][0]].speed * 2
    assert share_in_reach(network, 2.0, 50.0)[A, slot("E-straight")] == pytest.approx(reach / 50)


def test_advanced_max_pressure_counts_all_that_a_short_detector_sees(network):
    near = replace(context(network, interval=2.0), detector_length=20.0)
    far = replace(near, detector_length=None)
    seen = observe(
        network, vehicles={(A, "E-straight"): 4}, queue={(A, "N-straight"): 3}, phase=[0, 0]
    )
    chosen = []
    for known in (near, far):
        controller = AdvancedMaxPressure()
        controller.reset(known)
        chosen.append(controller.decide(seen)[A])
    assert chosen == [0, 1]
