"""The traffic model against arithmetic by hand, and the planner against all plans one by one."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.controllers.helpers import A, B, context, cross_and_tee, observe, slot
from tsc_missing.controllers.check import check_controller
from tsc_missing.controllers.max_queue import MaxQueue
from tsc_missing.controllers.point_queues import APPROACH_LOSS, START_LOSS, YELLOW_USE, PointQueues
from tsc_missing.controllers.rolling_horizon import (
    AHEAD,
    HISTORY,
    LEFT_OVER,
    LEFT_OVER_MORE,
    PhaseCosts,
    RollingHorizon,
)
from tsc_missing.imputation.base import Imputed
from tsc_missing.imputation.last_value import LastValue

NETWORK = cross_and_tee()
TRAVEL = 30.0 + APPROACH_LOSS  # [s] along 300 m at 10 m/s
HEADWAY = 2.5  # [s]
CONTEXT = replace(context(NETWORK), headway=HEADWAY, max_speed=20.0)
STRAIGHT = slot("W-straight")


def history(*counts, queue=None, slots=(A, STRAIGHT), network=NETWORK):
    """(1, C, N, 12, F): the last counts of one slot, and its queues, zeros elsewhere."""
    values = np.zeros((1, len(counts), *network.slot_mask.shape, 2))
    values[0, :, *slots, 0] = counts
    values[0, :, *slots, 1] = queue or [0] * len(counts)
    return values


def no_green(steps=HISTORY, network=NETWORK):
    return np.zeros((steps, *network.slot_mask.shape), dtype=bool)


def roads(given=CONTEXT, hold=1, ahead=AHEAD):
    return PointQueues(given, HISTORY, ahead, hold)


def random_values(seed, samples=1, network=NETWORK, most=12):
    random = np.random.default_rng(seed)
    queue = random.integers(0, most, (samples, HISTORY, *network.slot_mask.shape))
    running = random.integers(0, most, queue.shape)
    values = np.stack([queue + running, queue], axis=-1).astype(float)
    return values * network.slot_mask[..., None]


def random_green(seed, network=NETWORK):
    random = np.random.default_rng(seed)
    phases = random.integers(0, network.phase_mask.sum(axis=1), (HISTORY, network.n))
    return network.phases[np.arange(network.n), phases] | network.free_slots


def test_who_enters_reaches_the_stop_line_after_the_time_of_the_road():
    traffic = roads().estimate(history(0, 0, 0, 0, 3), no_green())
    # three entered in the last 15 s, evenly; they arrive from 34 - 15 = 19 s to 34 s from now
    got = traffic.arrivals[:, 0, A, STRAIGHT]
    assert np.allclose(got[:3], 0)
    assert got[3] == pytest.approx(3 * (20 - 19) / 15)
    assert got.sum() == pytest.approx(3)
    assert np.allclose(got[7:], 0)
    assert traffic.queue[0, A, STRAIGHT] == 0
    assert traffic.inflow[0, A, STRAIGHT] == pytest.approx(3 / 60)


def test_who_has_been_on_the_road_for_longer_waits_at_its_end():
    traffic = roads().estimate(history(0, 4, 4, 4, 4), no_green())
    assert traffic.queue[0, A, STRAIGHT] == pytest.approx(4)
    assert np.allclose(traffic.arrivals, 0)


def test_a_queue_that_is_seen_counts_even_if_the_model_has_it_under_way():
    values = history(0, 0, 0, 0, 5, queue=[0, 0, 0, 0, 4])
    traffic = roads().estimate(values, no_green())
    assert traffic.queue[0, A, STRAIGHT] == 4
    assert traffic.arrivals[:, 0, A, STRAIGHT].sum() == pytest.approx(1)


def test_who_left_under_green_is_made_up_for_by_who_entered():
    green = no_green()
    green[:, A, STRAIGHT] = True
    values = history(10, 10, 10, 10, 10, queue=[10] * 5)
    traffic = roads().estimate(values, green)
    assert traffic.inflow[0, A, STRAIGHT] == pytest.approx(1 / HEADWAY)


def test_green_that_begins_loses_the_yellow_and_the_start():
    capacity = roads().step_capacity[:, :, :, A, STRAIGHT].sum(axis=0)
    assert capacity[1, 1] == pytest.approx(15 / HEADWAY)
    assert capacity[0, 1] == pytest.approx((15 - 5 - START_LOSS) / HEADWAY)
    assert capacity[1, 0] == pytest.approx(YELLOW_USE / HEADWAY)
    assert capacity[0, 0] == 0
    two_lanes = roads().step_capacity[:, 1, 1, B, STRAIGHT].sum()
    shared = roads().step_capacity[:, 1, 1, B, slot("E-left")].sum()
    assert two_lanes == pytest.approx(2 * 15 / HEADWAY)
    assert shared == pytest.approx(0.5 * 15 / HEADWAY)


def test_a_stage_of_several_steps_loses_time_once():
    capacity = roads(hold=3).capacity[:, 0, 1, A, STRAIGHT]
    assert len(capacity) == 9
    assert capacity.sum() == pytest.approx((45 - 5 - START_LOSS) / HEADWAY)


def test_area_detectors_see_who_is_near_only():
    near = roads(replace(CONTEXT, detector_length=50.0))
    traffic = near.estimate(history(0, 0, 0, 0, 3), no_green())
    assert traffic.queue[0, A, STRAIGHT] == pytest.approx(3 * (15 - 9) / 15)  # 9 s to the line
    assert traffic.arrivals[:2, 0, A, STRAIGHT].sum() == pytest.approx(3 * 9 / 15)


@given(st.integers(0, 10**6), st.integers(1, 3))
@settings(max_examples=40, deadline=None)
def test_nobody_is_made_up_or_lost(seed, samples):
    values = random_values(seed, samples)
    traffic = roads(ahead=6).estimate(values, random_green(seed))
    vehicles, queue = values[:, -1, :, :, 0], values[:, -1, :, :, 1]
    arriving = traffic.arrivals.sum(axis=0)
    assert (traffic.queue >= queue - 1e-9).all()
    assert (traffic.arrivals >= 0).all()
    assert (traffic.inflow >= 0).all()
    assert (traffic.queue <= np.maximum(vehicles, queue) + 1e-9).all()
    assert (traffic.queue + arriving <= vehicles + 1e-9).all()
    # after 90 s, longer than the road, all of them have arrived
    assert np.allclose((traffic.queue + arriving), vehicles)


@given(st.integers(0, 10**6))
@settings(max_examples=20, deadline=None)
def test_later_arrivals_are_who_enters_soon_enough(seed):
    model = roads()
    entering = np.random.default_rng(seed).uniform(
        0, 2, (model.horizon, 1, *NETWORK.phases[:, 0].shape)
    )
    later = model.later_arrivals(entering)
    in_time = entering[: int((60 - TRAVEL) // 5)]
    arrived = later[..., A, STRAIGHT].sum()
    assert in_time[..., A, STRAIGHT].sum() - 1e-9 <= arrived
    assert arrived <= entering[: len(in_time) + 1, ..., A, STRAIGHT].sum() + 1e-9


def costs_by_hand(queue, arrivals, green, n, network=NETWORK):
    """{first phase: vehicle-seconds of its best plan}, every plan simulated for itself."""
    model = roads()
    phases = range(int(network.phase_mask[n].sum()))
    planned = network.slot_mask[n] & ~network.free_slots[n] & network.phases[n].any(axis=0)
    best = dict.fromkeys(phases, np.inf)
    for plan in product(phases, repeat=AHEAD):
        total = 0.0
        for s in np.flatnonzero(planned):
            standing, before, t = queue[n, s], bool(green[n, s]), 0
            for phase in plan:
                now = bool(network.phases[n, phase, s])
                for k in range(3):
                    out = model.capacity[k, int(before), int(now), n, s]
                    standing = max(standing + arrivals[t, n, s] - out, 0.0)
                    total += 5.0 * standing
                    t += 1
                before = now
            total += LEFT_OVER * standing + LEFT_OVER_MORE * standing**2
        best[plan[0]] = min(best[plan[0]], total)
    return best


@pytest.mark.parametrize("n", [A, B])
def test_costs_are_those_of_the_best_plan(n):
    values, green = random_values(3), random_green(4)
    model = PhaseCosts(CONTEXT)
    traffic = model._roads.estimate(values, green)
    arrivals = traffic.arrivals[:, 0]
    got = model._costs(traffic.queue, traffic.arrivals, green[-1])[n]
    expected = costs_by_hand(traffic.queue[0], arrivals, green[-1], n)
    first = got.reshape(4, -1).min(axis=1)
    assert np.allclose(first[: len(expected)], list(expected.values()))
    assert np.isinf(first[len(expected) :]).all()


@given(st.integers(0, 10**6))
@settings(max_examples=15, deadline=None)
def test_a_plan_costs_the_mean_over_the_samples(seed):
    values, green = random_values(seed, samples=3), random_green(seed)
    model = PhaseCosts(CONTEXT)
    traffic = model._roads.estimate(values, green)
    parts = [model._roads.estimate(values[[k]], green) for k in range(3)]
    together = model._costs(traffic.queue, traffic.arrivals, green[-1])
    alone = [model._costs(part.queue, part.arrivals, green[-1]) for part in parts]
    assert np.allclose(together, np.mean(alone, axis=0))
    same = np.repeat(values[:1], 3, axis=0)
    assert np.allclose(model.of(same, green), model.of(values[:1], green))


def test_a_hole_spoils_its_intersection_and_what_it_feeds():
    values = random_values(0)
    values[0, 2, B, slot("E-straight")] = np.nan
    costs = PhaseCosts(CONTEXT).of(values, random_green(0))
    assert np.isnan(costs[B, :3]).any()


def decide(controller, given, observations):
    controller.reset(given)
    return [controller.decide(one).tolist() for one in observations][-1]


def test_a_platoon_is_served_when_it_arrives():
    """Six vehicles are about to reach the stop line; max-queue sees one that stands elsewhere."""
    queue = {(A, "N-straight"): 1}
    seen = [
        observe(NETWORK, {(A, "N-straight"): 1, (A, "W-straight"): count}, queue, phase=[0, 0])
        for count in (0, 6, 6, 6)
    ]
    red = np.ones_like(NETWORK.slot_mask, dtype=np.int64)
    seen = [replace(one, red_steps=red) for one in seen]
    assert decide(MaxQueue(), CONTEXT, seen)[A] == 1
    assert decide(RollingHorizon(), CONTEXT, seen)[A] == 0


def test_green_stays_for_who_comes_within_a_step():
    """To change would lose the yellow: one vehicle elsewhere waits until the platoon is through."""
    green = np.where(NETWORK.phases[:, 0], 0, 3)
    queue = {(A, "N-straight"): 2, (A, "W-straight"): 9, (A, "E-straight"): 9}
    seen = [replace(observe(NETWORK, queue, queue, phase=[0, 0]), red_steps=green)] * 3
    assert decide(RollingHorizon(), CONTEXT, seen)[A] == 0


def test_what_upstream_sends_is_expected():
    """A road that is 20 s long: B is told of the queue that A is about to let go."""
    short = cross_and_tee()
    lanes = {
        name: lane.model_copy(update={"length": 60.0}) if lane.road == "AB" else lane
        for name, lane in short.record.lanes.items()
    }
    short = replace(short, record=short.record.model_copy(update={"lanes": lanes}))
    given = replace(CONTEXT, network=short)
    green = np.broadcast_to(np.where(short.phases[:, 0], 0, 9) == 0, (HISTORY, 2, 12))
    values = np.zeros((1, HISTORY, 2, 12, 2))
    values[0, :, B, slot("S-left")] = 2
    quiet = PhaseCosts(given).of(values, green)[B]
    values[0, :, A, STRAIGHT] = 20
    busy = PhaseCosts(given).of(values, green)[B]
    assert busy.min() > quiet.min()
    far = PhaseCosts(CONTEXT).of(values, green)[B]  # 34 s away: only the end of the plan sees it
    assert busy[2] > far[2]


def test_long_minimum_greens_and_many_phases_make_plans_shorter_not_wrong():
    long = replace(CONTEXT, min_steps=np.array([1, 3]))
    assert PhaseCosts(long)._roads.stage == 9
    fine = replace(CONTEXT, decision_interval=5.0, lost_time=3.0)
    costs = PhaseCosts(fine)
    assert costs._roads.stage == 3
    assert np.isfinite(costs.of(random_values(1), random_green(1))[A]).all()
    many = [[name] for name in ("N-left", "E-left", "S-left", "W-left", "N-straight", "S-straight")]
    network = with_phases(many)
    costs = PhaseCosts(replace(CONTEXT, network=network))
    assert costs._ahead == 3
    assert costs.of(random_values(2), random_green(2, network)).shape == (2, 6)


def with_phases(names):
    node, other = NETWORK.record.intersections
    phases = tuple(
        type(node.phases[0])(
            name=str(p),
            links=tuple(k for k, link in enumerate(node.links) if link.slot in map(slot, phase)),
        )
        for p, phase in enumerate(names)
    )
    nodes = (node.model_copy(update={"phases": phases}), other)
    return replace(NETWORK, record=NETWORK.record.model_copy(update={"intersections": nodes}))


def test_it_conforms_behind_an_imputer():
    check_controller(lambda: Imputed(LastValue(), RollingHorizon()), NETWORK)


def test_it_forgets_on_reset():
    controller = RollingHorizon()
    busy = observe(NETWORK, {(A, "N-left"): 9}, {(A, "N-left"): 9}, phase=[0, 0])
    first = decide(controller, CONTEXT, [busy])
    decide(controller, CONTEXT, [observe(NETWORK)] * 3)
    assert decide(controller, CONTEXT, [busy]) == first
    assert first[A] == 3


@pytest.mark.parametrize(("interval", "substep"), [(15.0, 5.0), (4.0, 4.0), (12.0, 6.0)])
def test_steps_are_whole_parts_of_a_decision_step(interval, substep):
    given = replace(CONTEXT, decision_interval=interval, lost_time=3.0)
    assert roads(given).substep == pytest.approx(substep)
