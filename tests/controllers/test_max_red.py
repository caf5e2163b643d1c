from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.controllers.helpers import (
    A,
    Scripted,
    context,
    cross_and_tee,
    observe,
    slot,
    with_holes,
)
from tests.networks import grid_network, tee_network
from tsc_missing.controllers.blind import Blind
from tsc_missing.controllers.fixed_time import Cycle
from tsc_missing.controllers.max_red import MaxRed
from tsc_missing.controllers.registry import make_controller
from tsc_missing.controllers.spillback import lane_share
from tsc_missing.offline.log import red_steps_of

STEP = 15.0


@pytest.fixture
def network():
    return cross_and_tee()


def decide(network, observations, max_red=120.0, answer=(1, 2), beliefs=None):
    """What is decided after the last of ``observations``."""
    scripted = Scripted(np.array(answer))
    scripted.estimates = lambda: beliefs
    controller = MaxRed(scripted, max_red)
    controller.reset(context(network, interval=STEP))
    return [controller.decide(seen).tolist() for seen in observations][-1]


def waiting(network, steps, count=1.0, silent=()):
    """West-left of A red from step 1 with ``count`` vehicles; its sensor is at times silent."""
    seen = []
    for step in range(steps + 1):
        now = observe(network, vehicles={(A, "W-left"): count})
        red = now.red_steps.copy()
        red[A, slot("W-left")] = step
        holes = np.zeros((2, 12), dtype=bool)
        holes[A, slot("W-left")] = step in silent
        seen.append(with_holes(replace(now, step=step, red_steps=red), holes))
    return seen


def test_a_vehicle_is_served_before_its_red_gets_longer_than_the_maximum(network):
    assert decide(network, waiting(network, 7)) == [1, 2]
    assert decide(network, waiting(network, 8)) == [2, 2]


def test_where_nobody_waits_no_red_ends(network):
    assert decide(network, waiting(network, 50, count=0.0)) == [1, 2]


def test_who_comes_to_a_long_red_has_not_waited_for_all_of_it(network):
    seen = waiting(network, 50, count=0.0) + waiting(network, 57)[51:]
    assert decide(network, seen) == [1, 2]
    seen += waiting(network, 58)[58:]
    assert decide(network, seen) == [2, 2]


def test_a_movement_whose_sensor_is_silent_counts_as_waiting(network):
    silent = range(100)
    assert decide(network, waiting(network, 7, silent=silent)) == [1, 2]
    assert decide(network, waiting(network, 8, silent=silent)) == [2, 2]


def test_a_silence_after_the_slot_was_seen_empty_counts_from_then(network):
    seen = waiting(network, 50, count=0.0) + waiting(network, 57, silent=range(100))[51:]
    assert decide(network, seen) == [1, 2]
    seen += waiting(network, 58, silent=range(100))[58:]
    assert decide(network, seen) == [2, 2]


@pytest.mark.parametrize(("believed", "steps"), [(0.4, 15), (0.5, 8), (np.nan, 8), (0.0, 15)])
def test_a_silent_movement_that_is_believed_empty_waits_twice_as_long(network, believed, steps):
    beliefs = np.full((2, 12, 2), believed)
    for count, phases in ((steps - 1, [1, 2]), (steps, [2, 2])):
        seen = waiting(network, count, silent=range(100))
        assert decide(network, seen, beliefs=beliefs) == phases
        reporting = waiting(network, min(count, 8))  # what is seen goes before beliefs
        assert decide(network, reporting, beliefs=beliefs) == [1 if count < 8 else 2, 2]


def test_steps_in_which_it_was_not_asked_count_as_waiting(network):
    assert decide(network, waiting(network, 7)[-1:]) == [1, 2]
    assert decide(network, waiting(network, 8)[-1:]) == [2, 2]
    assert decide(network, waiting(network, 8)[:2] + waiting(network, 8)[-1:]) == [2, 2]


def test_the_longer_wait_goes_first_and_among_equals_the_controllers_own(network):
    def seen(steps):
        both = []
        for k, one in enumerate(waiting(network, 10)):
            values, red = one.values.copy(), one.red_steps.copy()
            values[A, slot("N-left")] = 1.0
            red[A, slot("N-left")] = max(k - (10 - steps), 0)
            both.append(replace(one, values=values, red_steps=red))
        return both

    assert decide(network, seen(9)) == [2, 2]
    assert decide(network, seen(9), answer=(3, 0)) == [2, 0]
    assert decide(network, seen(10), answer=(2, 0)) == [2, 0]
    assert decide(network, seen(10), answer=(3, 0)) == [3, 0]


def test_an_answer_that_is_no_phase_stays_one_for_the_fallback_to_see(network):
    assert decide(network, waiting(network, 1), answer=(-1, 2)) == [-1, 2]


@settings(max_examples=40, deadline=None)
@given(
    build=st.sampled_from([lambda: grid_network(1, 2), tee_network, cross_and_tee]),
    max_red=st.sampled_from([60.0, 120.0, 240.0]),
    seed=st.integers(0, 2**32 - 1),
)
def test_no_red_lasts_longer_whatever_the_controller_says(build, max_red, seed):
    network = build()
    rng = np.random.default_rng(seed)
    favourite = np.array([rng.integers(row.sum()) for row in network.phase_mask])
    controller = MaxRed(Scripted(favourite), max_red)
    controller.reset(context(network, interval=STEP))
    there = network.phases.any(axis=1) & network.slot_mask
    full = np.where(there, 1.0, 0.0)
    seen = replace(observe(network), values=np.stack([full, full], axis=2))
    phases = []
    for step in range(80):
        red = red_steps_of(network, np.array([*phases, favourite]))[-1]
        phases.append(controller.decide(replace(seen, step=step, red_steps=red)))
    red = red_steps_of(network, np.array(phases))
    most = max_red / STEP + network.phase_mask.shape[1] - 1  # the others may be overdue with it
    assert red[:, there & ~network.free_slots].max() <= most


@settings(max_examples=40, deadline=None)
@given(
    build=st.sampled_from([lambda: grid_network(1, 2), tee_network, cross_and_tee]),
    max_red=st.sampled_from([60.0, 120.0]),
    seed=st.integers(0, 2**32 - 1),
)
def test_no_red_lasts_longer_than_twice_however_wrong_beliefs_are(build, max_red, seed):
    network = build()
    rng = np.random.default_rng(seed)
    favourite = Scripted(np.array([rng.integers(row.sum()) for row in network.phase_mask]))
    controller = MaxRed(favourite, max_red)
    controller.reset(context(network, interval=STEP))
    shape = network.slot_mask.shape
    there = network.phases.any(axis=1) & network.slot_mask
    full = replace(observe(network), values=np.repeat(np.where(there, 1.0, 0.0)[..., None], 2, 2))
    phases = []
    for step in range(80):
        beliefs = rng.choice([0.0, 0.1, 0.6, np.nan, np.inf, -np.inf], (*shape, 2))
        favourite.estimates = lambda beliefs=beliefs: beliefs
        holes = (rng.random(shape) < 0.7) & network.slot_mask
        red = red_steps_of(network, np.array([*phases, favourite.decide(full)]))[-1]
        phases.append(controller.decide(with_holes(replace(full, step=step, red_steps=red), holes)))
    red = red_steps_of(network, np.array(phases))
    most = 2 * max_red / STEP + network.phase_mask.shape[1] - 1
    assert red[:, there & ~network.free_slots].max() <= most


def test_where_all_report_and_nobody_leaves_it_bounds_the_red_itself(network):
    for steps in range(1, 12):
        assert (decide(network, waiting(network, steps)) == [2, 2]) == (15 * (steps + 1) > 120)


def test_a_lane_that_slots_share_is_not_empty_because_each_has_a_part_of_it(network):
    share = lane_share(network)
    n, k = np.argwhere(share < 1)[0]
    for vehicles, steps in ((0.4, 15), (0.6, 8)):
        beliefs = np.full((2, 12, 2), vehicles) * share[..., None]
        seen = []
        for step in range(steps + 1):
            now = observe(network)
            red = now.red_steps.copy()
            red[n, k] = step
            holes = np.zeros((2, 12), dtype=bool)
            holes[n, k] = True
            seen.append(with_holes(replace(now, step=step, red_steps=red), holes))
        other = np.flatnonzero(~network.phases[n, :, k] & network.phase_mask[n])[0]
        answer = np.array([1, 2])
        answer[n] = other
        assert decide(network, seen[:-1], answer=answer, beliefs=beliefs)[n] == other
        assert network.phases[n, decide(network, seen, answer=answer, beliefs=beliefs)[n], k]


def test_controllers_have_it_and_plans_do_not():
    bounded = make_controller("max-queue", "last", "fixed-time", max_red=240)
    assert isinstance(bounded, Blind)
    assert isinstance(bounded.controller, MaxRed)
    for name in ("random", "expected-queue"):
        assert isinstance(make_controller(name, "last", "none", max_red=240), MaxRed)
    for name in ("fixed-time", "fixed-time-15"):
        assert isinstance(make_controller(name, "last", "none", max_red=240), Cycle)
    blind = make_controller("max-queue", "last", "expected-queue", max_red=240)
    assert isinstance(blind, Blind)
    assert isinstance(blind.cycle, MaxRed)
