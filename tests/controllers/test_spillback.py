from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.controllers.helpers import (
    A,
    B,
    Scripted,
    context,
    cross_and_tee,
    observe,
    slot,
    with_holes,
)
from tests.networks import context_for, grid_network, tee_network
from tsc_missing.config import MIN_SPACE, MIN_SPACE_AHEAD, DiffusionSettings, RunSettings
from tsc_missing.controllers.check import check_controller
from tsc_missing.controllers.fixed_time import FixedTime
from tsc_missing.controllers.max_red import MaxRed
from tsc_missing.controllers.registry import make_controller
from tsc_missing.controllers.resolved import min_space_of
from tsc_missing.controllers.spillback import Room, Spillback, lane_share, storage

FITS = 40  # vehicles on a lane of 300 m


@pytest.fixture
def network():
    return cross_and_tee()


def decide(network, observation, space=9, answer=(1, 2), estimate=None):
    inner = Scripted(np.array(answer))
    inner.estimate = estimate
    controller = Spillback(inner, space)
    controller.reset(context(network))
    return controller.decide(observation).tolist()


def holding(network, **vehicles):
    """West-straight of B, which A feeds over two lanes, or east-left of A, which B feeds."""
    names = {"b": (B, "W-straight"), "a": (A, "E-left"), "entry": (A, "N-straight")}
    return observe(network, vehicles={names[name]: count for name, count in vehicles.items()})


def test_storage_is_of_all_lanes_of_a_slot(network):
    fits = storage(network, spacing=7.5)
    assert fits[A, slot("E-left")] == FITS
    assert fits[B, slot("W-straight")] == 2 * FITS
    assert not fits[~network.slot_mask].any()


def test_vehicles_on_a_lane_that_slots_share_are_counted_once(network):
    share = lane_share(network)
    n, k = np.argwhere(share < 1)[0]
    assert share[n, k] == 0.5
    assert (share[A] == 1).all()
    room = Room(network, 3, spacing=7.5)
    room._fed[n, k] = True
    answer = np.array([1, 2])
    answer[n] = np.flatnonzero(~network.phases[n, :, k] & network.phase_mask[n])[0]
    vehicles = np.zeros(network.slot_mask.shape)
    for on_lane, stays in ((0.9, True), (FITS - 3, True), (FITS - 2, False)):
        vehicles[n, k] = on_lane * share[n, k]
        assert (room.kept(answer, vehicles)[n] == answer[n]) == stays


def test_a_road_is_served_once_a_lane_has_room_for_fewer(network):
    assert decide(network, holding(network, a=31)) == [1, 2]
    assert decide(network, holding(network, a=32)) == [2, 2]
    assert decide(network, holding(network, b=62)) == [1, 2]
    assert decide(network, holding(network, b=63)) == [1, 0]


def test_the_fullest_is_first_and_the_controllers_phase_stays_where_it_serves_as_much(network):
    both = holding(network, a=33)
    both.values[A, slot("E-straight"), 0] = 36
    assert decide(network, both) == [0, 2]
    assert decide(network, holding(network, a=33), answer=(2, 2)) == [2, 2]


def test_roads_on_which_vehicles_enter_the_network_do_not_count(network):
    assert decide(network, holding(network, entry=40)) == [1, 2]


def test_an_empty_lane_is_not_filling_however_short_it_is(network):
    assert decide(network, holding(network), space=1000) == [1, 2]
    assert decide(network, holding(network, a=1), space=1000) == [2, 2]


def test_an_estimate_stands_in_for_a_sensor_that_did_not_report(network):
    seen = holding(network, a=35)
    dark = with_holes(seen, seen.values[:, :, 0] > 0)
    assert decide(network, dark) == [1, 2]
    assert decide(network, dark, estimate=seen.values) == [2, 2]
    full = np.full_like(seen.values, 99.0)
    assert decide(network, holding(network), estimate=full) == [1, 2]  # what is seen counts


def test_where_no_sensor_ever_reports_a_road_fills_while_it_is_red(network):
    """An estimate of nothing, wrong for an hour, must not keep a road red until it is full."""
    nothing = np.zeros((2, 12, 2))
    dark = with_holes(holding(network), network.slot_mask)

    def answer(red_steps, sensors):
        inner = Scripted(np.array([1, 2]))
        inner.estimate = nothing
        controller = Spillback(inner, FITS - 1)
        controller.reset(replace(context(network), sensors=sensors))
        dark.red_steps[:] = 0
        dark.red_steps[A, slot("E-left")] = red_steps
        return controller.decide(dark).tolist()

    everywhere, nowhere = network.slot_mask, np.zeros_like(network.slot_mask)
    assert answer(4, nowhere) == [1, 2]
    assert answer(5, nowhere) == [2, 2]
    assert answer(1000, nowhere) == [2, 2]
    assert answer(1000, everywhere) == [1, 2]


def test_a_sensor_that_reports_no_number_did_not_report(network):
    seen = holding(network, a=35)
    full = seen.values.copy()
    seen.values[A, slot("E-left")] = np.nan
    assert decide(network, seen, estimate=full) == [2, 2]


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
def test_estimates_that_are_no_numbers_change_nothing(network, number):
    dark = with_holes(holding(network), network.slot_mask)
    estimate = np.full((2, 12, 2), number)
    assert decide(network, dark, estimate=estimate) == [1, 2]


def test_no_answer_of_the_controller_stays_none_but_where_a_road_fills(network):
    assert decide(network, holding(network, a=35), answer=(-1, -1)) == [2, -1]


@pytest.mark.parametrize("build", [lambda: grid_network(2, 3), tee_network, cross_and_tee])
@given(seed=st.integers(0, 2**16), space=st.integers(1, 30))
@settings(max_examples=25, deadline=None)
def test_phases_are_always_those_of_the_network(build, seed, space):
    network = build()
    random = np.random.default_rng(seed)
    phases = random.integers(0, network.phase_mask.sum(axis=1))
    controller = Spillback(Scripted(phases), space)
    controller.reset(context_for(network))
    seen = observe(network)
    seen.values[:] = random.integers(0, 60, seen.values.shape) * network.slot_mask[:, :, None]
    dark = random.random(network.slot_mask.shape) < 0.5
    chosen = controller.decide(with_holes(seen, dark))
    assert network.phase_mask[np.arange(network.n), chosen].all()


def test_it_conforms():
    check_controller(lambda: Spillback(FixedTime(), 9), cross_and_tee())


def test_who_has_it():
    queue = RunSettings(controller="max-queue")
    assert min_space_of(RunSettings()) == MIN_SPACE_AHEAD
    assert min_space_of(RunSettings(diffusion=DiffusionSettings(scoring="value"))) == MIN_SPACE
    for scoring in ("inverse", "mixed", "queue"):
        assert min_space_of(RunSettings(diffusion=DiffusionSettings(scoring=scoring))) == 0
    assert min_space_of(RunSettings(controller="rolling-horizon")) == MIN_SPACE_AHEAD
    assert min_space_of(queue) == 0
    given_space = queue.signals.model_copy(update={"min_space": 4})
    assert min_space_of(queue.model_copy(update={"signals": given_space})) == 4
    assert isinstance(make_controller("max-queue", "last", "none", min_space=4), Spillback)


def test_a_maximum_red_has_the_last_word_so_that_short_roads_starve_nobody():
    controller = make_controller("max-queue", "last", "none", max_red=240, min_space=4)
    assert isinstance(controller, MaxRed)
    assert isinstance(controller.controller, Spillback)
