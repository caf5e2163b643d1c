"""The traffic model against arithmetic by hand, and the planner against all plans one by one."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.controllers.helpers import A, B, context, cross_and_tee, observe, slot, with_holes
from tsc_missing.controllers.check import check_controller
from tsc_missing.controllers.max_queue import MaxQueue
from tsc_missing.controllers.point_queues import (
    APPROACH_LOSS,
    GAIN,
    LEAST_HEADWAY,
    MEMORY,
    START_LOSS,
    YELLOW_USE,
    PointQueues,
)
from tsc_missing.controllers.rolling_horizon import (
    AHEAD,
    LEFT_OVER,
    LEFT_OVER_MORE,
    HorizonPlans,
    RollingHorizon,
)
from tsc_missing.controllers.spillback import storage

NETWORK = cross_and_tee()
TRAVEL = 30.0 + APPROACH_LOSS  # [s] along 300 m at 10 m/s
HEADWAY = 2.5  # [s]: 1.75 s and 7.5 m at 10 m/s
CONTEXT = replace(context(NETWORK), tau=1.75, max_speed=20.0)
STRAIGHT = slot("W-straight")
HOLES = st.integers(0, 10**6)


def roads(given=CONTEXT, hold=1, ahead=AHEAD):
    return PointQueues(given, ahead, hold)


def seen(vehicles=None, queue=None, green=()):
    """Everything reported: zeros but for what is named, red but for the slots (n, name)."""
    red = np.ones_like(NETWORK.slot_mask, dtype=np.int64)
    for n, name in green:
        red[n, slot(name)] = 0
    return replace(observe(NETWORK, vehicles, queue), red_steps=red)


def after(model, *observations):
    return [model.take(one) for one in observations][-1]


def counts(*vehicles, green=(), name="W-straight", queue=0):
    return [seen({(A, name): v}, {(A, name): queue}, green) for v in vehicles]


def random_observation(random, holes=0.0):
    queue = random.integers(0, 9, NETWORK.slot_mask.shape) * NETWORK.slot_mask
    vehicles = queue + random.integers(0, 9, queue.shape) * NETWORK.slot_mask
    phases = random.integers(0, NETWORK.phase_mask.sum(axis=1))
    green = NETWORK.phases[np.arange(NETWORK.n), phases] | NETWORK.free_slots
    values = np.stack([vehicles, queue], axis=2).astype(float)
    whole = replace(observe(NETWORK), values=values, red_steps=np.where(green, 0, 3))
    hidden = (random.random(queue.shape) < holes) & NETWORK.slot_mask
    return with_holes(whole, hidden)


def test_who_enters_reaches_the_stop_line_after_the_time_of_the_road():
    traffic = after(roads(), *counts(0, 0, 3))
    # three entered in the last 15 s, evenly: they arrive from 34 - 15 = 19 s to 34 s from now
    got = traffic.arrivals[:, A, STRAIGHT]
    assert np.allclose(got[:3], 0)
    assert got[3] == pytest.approx(3 * (20 - 19) / 15)
    assert got.sum() == pytest.approx(3)
    assert np.allclose(got[7:], 0)
    assert traffic.queue[A, STRAIGHT] == 0
    assert traffic.inflow[A, STRAIGHT] == pytest.approx(MEMORY * 3 / 15)


def test_who_has_been_on_the_road_for_longer_waits_at_its_end():
    traffic = after(roads(), *counts(0, 4, 4, 4, 4))
    assert traffic.queue[A, STRAIGHT] == pytest.approx(4)
    assert np.allclose(traffic.arrivals, 0)


def test_a_queue_that_is_seen_counts_even_if_the_model_has_it_under_way():
    traffic = after(roads(), *counts(0, 0), *counts(5, queue=4))
    assert traffic.queue[A, STRAIGHT] == 4
    assert traffic.arrivals[:, A, STRAIGHT].sum() == pytest.approx(1)


def test_who_left_under_green_is_made_up_for_by_who_entered():
    model = roads()
    green = [(A, "W-straight")]
    traffic = after(model, *counts(*[10] * 200, green=green, queue=10))
    assert traffic.inflow[A, STRAIGHT] == pytest.approx(1 / HEADWAY, rel=1e-3)


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
    traffic = after(near, *counts(0, 0, 3))
    assert traffic.queue[A, STRAIGHT] == pytest.approx(3 * (15 - 9) / 15)  # 9 s to the line
    assert traffic.arrivals[:2, A, STRAIGHT].sum() == pytest.approx(3 * 9 / 15)


def silences(count, flow=240.0):
    """So many steps in which west-straight of A does not report, where one comes in 15 s; roads."""
    flows = np.zeros(NETWORK.slot_mask.shape)
    flows[A, STRAIGHT] = flow
    holes = np.zeros(NETWORK.slot_mask.shape, dtype=bool)
    holes[A, STRAIGHT] = True
    return [with_holes(seen(), holes)] * count, roads(replace(CONTEXT, turning_flows=flows))


def evenly(count, steps):
    """(T,) arrivals, and the queue, if ``count`` entered evenly in so many steps until now."""
    seconds = 15.0 * steps
    ends = np.clip(np.arange(0, 40, 5) + seconds - TRAVEL, 0, seconds)  # entered, here by 0, 5, …
    return count * np.diff(ends) / seconds, count * ends[0] / seconds


@pytest.mark.parametrize("count", [0.0, 1.0, 2.0, 6.0])
@pytest.mark.parametrize("flow", [240.0, 0.0])
@pytest.mark.parametrize("silent", [1, 2])
def test_a_report_after_a_silence_is_spread_over_it(count, flow, silent):
    unseen, model = silences(silent, flow)
    traffic = after(model, seen(), *unseen, *counts(count))
    arrivals, queue = evenly(count, silent + 1)
    assert traffic.arrivals[:7, A, STRAIGHT] == pytest.approx(arrivals, abs=1e-5)
    assert traffic.queue[A, STRAIGHT] == pytest.approx(queue, abs=1e-5)


@pytest.mark.parametrize("silent", [1, 2, 5, 20])
def test_a_report_that_is_as_predicted_changes_nothing(silent):
    unseen, model = silences(silent + 1)
    predicted = after(model, seen(), *unseen)
    count = model.values[A, STRAIGHT, 0]
    unseen, model = silences(silent)
    told = after(model, seen(), *unseen, *counts(count))
    np.testing.assert_allclose(told.arrivals, predicted.arrivals, atol=1e-5)
    np.testing.assert_allclose(told.queue, predicted.queue, atol=1e-5)


@pytest.mark.parametrize("silent", [0, 1, 5, 20, 40])
def test_who_drives_under_green_after_a_silence_does_not_queue(silent):
    green = [(A, "W-straight")]
    unseen, model = silences(silent)
    unseen = [replace(one, red_steps=seen(green=green).red_steps) for one in unseen]
    before = counts(0, 1, 2, 2, green=green)
    traffic = after(model, *before, *unseen, *counts(5, green=green))
    # no step of the silence is left to put more than it can have brought by now
    assert traffic.queue[A, STRAIGHT] < 1.5


def test_a_count_above_the_room_is_not_counted_twice():
    unseen, model = silences(1, flow=0.0)
    many = storage(NETWORK, CONTEXT.spacing)[A, STRAIGHT] + 5
    traffic = after(model, *counts(many, many, queue=many), *unseen, *counts(many, queue=many))
    assert traffic.arrivals.sum() == pytest.approx(0, abs=0.01)


@given(HOLES, st.floats(0.1, 0.9), st.booleans())
@settings(max_examples=30, deadline=None)
def test_the_ledger_of_silences_is_a_part_of_the_calendar(seed, holes, guessed):
    random = np.random.default_rng(seed)
    model = roads()
    for _ in range(20):
        observation = random_observation(random, holes)
        model.take(observation, random.uniform(0, 20, (2, 12, 2)) if guessed else None)
        known = observation.mask
        assert (model._untold >= 0).all()
        assert (model._calendar >= model._untold - 1e-9).all()
        assert not model._untold[:, known].any()
        assert not model._silent[known].any()
        assert (model._silent <= model.values[:, :, 0] + 1e-9).all()


@pytest.mark.parametrize(("interval", "substep"), [(15.0, 5.0), (4.0, 4.0), (12.0, 6.0)])
def test_steps_are_whole_parts_of_a_decision_step(interval, substep):
    given = replace(CONTEXT, decision_interval=interval, lost_time=3.0)
    assert roads(given).substep == pytest.approx(substep)


@given(HOLES, st.integers(1, 9), st.booleans())
@settings(max_examples=40, deadline=None)
def test_nobody_is_made_up_or_lost(seed, steps, guessed):
    random = np.random.default_rng(seed)
    model = roads(ahead=6)  # 90 s, longer than the road
    for _ in range(steps):
        observation = random_observation(random, holes=0.4)
        guess = random.uniform(0, 20, (2, 12, 2)) if guessed else None
        traffic = model.take(observation, guess)
    there = NETWORK.slot_mask
    vehicles, queue = observation.values[..., 0], observation.values[..., 1]
    known = observation.mask & there
    arriving = traffic.arrivals.sum(axis=0)
    assert (traffic.arrivals >= 0).all()
    assert (traffic.inflow >= 0).all()
    assert (traffic.queue[known] >= queue[known] - 1e-9).all()
    room = storage(NETWORK, CONTEXT.spacing)
    assert (model.values[..., 0][~known & there] <= room[~known & there] + 1e-9).all()
    if steps > 1:  # what is seen first is taken to have just entered
        assert np.allclose((traffic.queue + arriving)[known], vehicles[known])
        assert np.allclose((traffic.queue + arriving)[there], model.values[..., 0][there])


def test_a_silent_road_gets_what_is_let_go_upstream():
    """A's queue has green; B does not report, and A's left turn and others send nothing."""
    model = roads()
    hidden = np.zeros_like(NETWORK.slot_mask)
    hidden[B] = NETWORK.slot_mask[B]
    green = [(A, "W-straight")]
    for vehicles in (20, 15, 10):
        values = {(A, "W-straight"): vehicles}
        model.take(with_holes(seen(values, values, green), hidden))
    west = [slot(f"W-{turn}") for turn in ("left", "straight", "right")]
    first, second = (15 - 5 - START_LOSS) / HEADWAY, 15 / HEADWAY
    assert model.values[B, west, 0].sum() == pytest.approx(min(first, second) + second, rel=0.4)
    away = [slot("E-straight"), slot("S-left")]
    assert np.allclose(model.values[B, away], 0, atol=0.01)  # nobody is known not to come


def test_turns_are_those_of_the_counts_at_first():
    flows = {(B, "W-straight"): 300.0, (B, "W-right"): 100.0}
    model = roads(replace(context(NETWORK, flows), tau=1.75))
    assert model.turns[B, slot("W-straight")] == pytest.approx(0.75, abs=1e-3)
    assert model.turns[A, STRAIGHT] == pytest.approx(1 / 3)
    assert np.allclose(model.turns.reshape(2, 4, 3).sum(axis=2)[A], 1)
    assert not model.turns[B][~NETWORK.slot_mask[B]].any()


def test_what_a_silence_hid_is_not_learned_as_the_inflow_of_a_step():
    """25 vehicles that came in ten silent steps are no 25 in one."""
    hidden = np.zeros_like(NETWORK.slot_mask)
    hidden[A, STRAIGHT] = True
    model = roads()
    model.take(seen())
    model.take(seen())
    usual = model.usual()[0, A, STRAIGHT]
    for _ in range(10):
        model.take(with_holes(seen(), hidden))
    model.take(*counts(25))
    assert model.usual()[0, A, STRAIGHT] == usual
    model.take(*counts(28))
    assert model.usual()[0, A, STRAIGHT] > usual


def test_a_guess_draws_what_is_not_seen_and_nothing_else():
    hidden = np.zeros_like(NETWORK.slot_mask)
    hidden[A, STRAIGHT] = True
    guess = np.full((2, 12, 2), 10.0)
    model = roads()
    for step in range(1, 4):
        model.take(with_holes(seen(), hidden), guess)
        expected = 10 * (1 - (1 - GAIN) ** step)
        assert model.values[A, STRAIGHT, 0] == pytest.approx(expected, rel=0.05)
    assert not model.values[B].any()


def test_a_guess_that_is_no_number_does_not_stay():
    hidden = np.zeros_like(NETWORK.slot_mask)
    hidden[A, STRAIGHT] = True
    model, other = roads(), roads()
    observation = with_holes(seen(), hidden)
    for guess in (np.full((2, 12, 2), np.nan), np.full((2, 12, 2), np.inf)):
        model.take(observation, guess)
        other.take(observation, np.zeros((2, 12, 2)))
    np.testing.assert_allclose(model.values, other.values, atol=1e-4)


def test_who_enters_is_told_by_the_signals_upstream_when_in_the_step():
    """A green at A that begins with the step lets nobody onto B's road before the yellow ends."""
    model = roads()
    waiting = {(A, "W-straight"): 20}
    model.take(seen(waiting, waiting))
    model.take(seen(waiting, waiting))
    let_go = {(A, "W-straight"): 17, (B, "W-right"): 3}
    traffic = model.take(seen(let_go, {(A, "W-straight"): 17}, [(A, "W-straight")]))
    got = traffic.arrivals[:, B, slot("W-right")]
    first = int((TRAVEL - 15 + 5) // 5)  # with an even inflow a third of them would come before
    assert np.allclose(got[:first], 0)
    assert got.sum() == pytest.approx(3)


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
    random = np.random.default_rng(3)
    model, observations = roads(), [random_observation(random) for _ in range(4)]
    traffic = after(model, *observations)
    green = observations[-1].red_steps == 0
    got = HorizonPlans(CONTEXT)._costs(traffic.queue, traffic.arrivals, green)[n]
    expected = costs_by_hand(traffic.queue, traffic.arrivals, green, n)
    first = got.reshape(4, -1).min(axis=1)
    assert np.allclose(first[: len(expected)], list(expected.values()))
    assert np.isinf(first[len(expected) :]).all()


@given(HOLES)
@settings(max_examples=20, deadline=None)
def test_what_is_under_the_mask_does_not_matter(seed):
    plain, poisoned = HorizonPlans(CONTEXT), HorizonPlans(CONTEXT)
    random = np.random.default_rng(seed)
    for _ in range(4):
        observation = random_observation(random, holes=0.5)
        assert np.isnan(observation.values).any()
        dirty = np.where(np.isnan(observation.values), 1e9, observation.values)
        first = plain.costs(observation)
        assert np.isfinite(first[NETWORK.phase_mask]).all()
        np.testing.assert_array_equal(first, poisoned.costs(replace(observation, values=dirty)))


def decide(controller, given, observations):
    controller.reset(given)
    return [controller.decide(one).tolist() for one in observations][-1]


def test_a_platoon_is_served_when_it_arrives():
    """Six vehicles are about to reach the stop line; max-queue sees one that stands elsewhere."""
    queue = {(A, "N-straight"): 1}
    observations = [
        seen({(A, "N-straight"): 1, (A, "W-straight"): count}, queue) for count in (0, 6, 6, 6)
    ]
    assert decide(MaxQueue(), CONTEXT, observations)[A] == 1
    assert decide(RollingHorizon(), CONTEXT, observations)[A] == 0


def test_green_stays_for_a_queue_that_is_not_through():
    """To change would lose the yellow: two vehicles elsewhere wait."""
    queue = {(A, "N-straight"): 2, (A, "W-straight"): 9, (A, "E-straight"): 9}
    observations = [seen(queue, queue, [(A, "W-straight"), (A, "E-straight")])] * 3
    assert decide(RollingHorizon(), CONTEXT, observations)[A] == 0


def test_what_upstream_sends_is_expected():
    """A road that takes 10 s: B is told of the queue that A is about to let go."""
    lanes = {
        name: lane.model_copy(update={"length": 60.0}) if lane.road == "AB" else lane
        for name, lane in NETWORK.record.lanes.items()
    }
    short = replace(NETWORK, record=NETWORK.record.model_copy(update={"lanes": lanes}))
    green = [(A, "W-straight"), (A, "E-straight")]

    def at_b(network, queue):
        plans = HorizonPlans(replace(CONTEXT, network=network))
        waits = {(B, "S-left"): 2, (A, "W-straight"): queue}
        return [plans.costs(seen(waits, waits, green)) for _ in range(3)][-1][B, :3]

    quiet, busy, far = at_b(short, 0), at_b(short, 20), at_b(NETWORK, 20)
    assert busy.min() > quiet.min()
    assert busy[2] > far[2]  # 34 s away: seen by a plan's end only


def test_long_minimum_greens_and_many_phases_make_plans_shorter_not_wrong():
    assert HorizonPlans(replace(CONTEXT, min_steps=np.array([3, 4])))._roads.stage == 9
    fine = HorizonPlans(replace(CONTEXT, decision_interval=5.0, lost_time=3.0))
    assert fine._roads.stage == 3
    observation = random_observation(np.random.default_rng(1))
    assert np.isfinite(fine.costs(observation)[A]).all()
    names = ("N-left", "E-left", "S-left", "W-left", "N-straight", "S-straight")
    many = HorizonPlans(replace(CONTEXT, network=with_phases([[name] for name in names])))
    assert many._ahead == 3
    assert many.costs(observation).shape == (2, 6)


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


def test_it_conforms_without_an_imputer():
    check_controller(RollingHorizon, NETWORK)


def test_estimates_are_what_was_seen_and_believed():
    controller, random = RollingHorizon(), np.random.default_rng(5)
    controller.reset(CONTEXT)
    assert controller.estimates() is None
    for _ in range(3):
        observation = random_observation(random, holes=0.5)
        controller.decide(observation)
        got = controller.estimates()
        np.testing.assert_array_equal(got[observation.mask], observation.values[observation.mask])
        assert np.isfinite(got).all()
    controller.reset(CONTEXT)
    assert controller.estimates() is None


def test_a_queue_does_not_leave_at_the_speed_limit():
    fast = roads(replace(CONTEXT, tau=1.0))
    assert fast.step_capacity[:, 1, 1, A, STRAIGHT].sum() == pytest.approx(15 / LEAST_HEADWAY)


def test_one_long_phase_does_not_make_all_plans_coarse():
    observation = random_observation(np.random.default_rng(0))
    slow = replace(CONTEXT, min_steps=np.array([1, 5]))
    plain, other = (HorizonPlans(one).costs(observation) for one in (CONTEXT, slow))
    assert CONTEXT.min_steps.tolist() == [1, 1]
    np.testing.assert_array_equal(other, plain)
