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
from tsc_missing.offline.log import red_steps_of

STEP = 15.0


@pytest.fixture
def network():
    return cross_and_tee()


def decide(network, observation, max_red=120.0, answer=(1, 2)):
    controller = MaxRed(Scripted(np.array(answer)), max_red)
    controller.reset(context(network, interval=STEP))
    return controller.decide(observation).tolist()


def waiting(network, red_steps, **given):
    """West-left of A red for so many steps, with a vehicle on it unless said otherwise."""
    seen = observe(network, vehicles={(A, "W-left"): 1.0, **given})
    red = seen.red_steps.copy()
    red[A, slot("W-left")] = red_steps
    return replace(seen, red_steps=red)


def test_a_vehicle_is_served_before_its_red_gets_longer_than_the_maximum(network):
    assert decide(network, waiting(network, 7)) == [1, 2]
    assert decide(network, waiting(network, 8)) == [2, 2]


def test_where_nobody_waits_no_red_ends(network):
    seen = waiting(network, 50)
    assert decide(network, replace(seen, values=np.zeros_like(seen.values))) == [1, 2]


def test_a_movement_whose_sensor_is_silent_counts_as_waiting(network):
    holes = np.zeros((2, 12), dtype=bool)
    holes[A, slot("W-left")] = True
    assert decide(network, with_holes(waiting(network, 50), holes)) == [2, 2]


def test_the_longer_red_goes_first_and_among_equals_the_controllers_own(network):
    seen = waiting(network, 10)
    red = seen.red_steps.copy()
    red[A, slot("N-left")] = 11
    values = seen.values.copy()
    values[A, slot("N-left")] = 1.0
    assert decide(network, replace(seen, values=values, red_steps=red)) == [3, 2]
    red[A, slot("N-left")] = 10
    assert decide(network, replace(seen, values=values, red_steps=red), answer=(2, 0)) == [2, 0]
    assert decide(network, replace(seen, values=values, red_steps=red), answer=(3, 0)) == [3, 0]


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
