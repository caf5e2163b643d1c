"""Turning flows without turning counts: what the roads around tell of slots without a sensor."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.networks import context_for, grid_network
from tsc_missing.controllers.uncounted import UncountedTurns
from tsc_missing.controllers.upstream import Roads
from tsc_missing.network.slots import N_SLOTS

NETWORK = grid_network(3, 3)
CENTRE = 4
SEEDS = st.integers(0, 10**6)
CONTEXT = replace(context_for(NETWORK), counted=False)


def without(blind):
    sensors = NETWORK.slot_mask.copy()
    sensors[blind] = False
    return replace(CONTEXT, sensors=sensors)


def steady(seed, roads):
    """Flows (N, 12) [vehicles/s] of which those that enter a fed road are those let go upstream."""
    random = np.random.default_rng(seed)
    share = roads.shares(random.uniform(0.05, 1.0, NETWORK.slot_mask.shape) * NETWORK.slot_mask)
    outside = np.where(roads.fed, 0.0, share * random.uniform(0.02, 0.2))
    enters = roads.parts[roads.road.ravel()] * share.ravel()[:, None]
    flows = np.linalg.solve(np.eye(len(enters)) - enters, outside.ravel())
    return flows.reshape(share.shape)


def by_road(roads, flows):
    return np.bincount(roads.road.ravel(), flows.ravel(), len(roads.parts))


@given(SEEDS, st.booleans())
@settings(max_examples=25, deadline=None)
def test_flows_fit_what_enters_and_what_comes_out(seed, guessed):
    context = without([CENTRE])
    roads = Roads.of(context)
    true = steady(seed, roads)
    even = roads.shares(NETWORK.slot_mask * 1.0) * by_road(roads, true)[roads.road]
    start = np.where(context.sensors, true, even)
    fitted = UncountedTurns(context, roads).fitted(start, guessed)
    assert (fitted[context.sensors] == true[context.sensors]).all()
    assert by_road(roads, fitted) == pytest.approx(by_road(roads, true))
    exits = roads.parts[:, CENTRE * N_SLOTS : (CENTRE + 1) * N_SLOTS].any(axis=1)

    def missed(flows):
        return np.abs(roads.parts @ flows.ravel() - roads.parts @ true.ravel())[exits].max()

    assert exits.sum() == 4
    assert missed(fitted) <= max(0.2 * missed(even), 2e-3)


def test_turns_that_nobody_sees_are_as_elsewhere():
    """Of a corner whose neighbours are blind too, neither entries nor exits are known."""
    context = without([0, 1, 3])
    roads = Roads.of(context)
    flows = np.tile([0.02, 0.1, 0.04], 4) * NETWORK.slot_mask
    start = np.where(context.sensors, flows, 0.3)
    fitted = UncountedTurns(context, roads).fitted(start, guessed=False)
    outside = NETWORK.slot_mask[0] & ~roads.fed[0]
    assert outside.sum() == 6
    assert fitted[0][outside] == pytest.approx(flows[0][outside], rel=1e-3)


@given(
    SEEDS, st.lists(st.integers(0, 8), max_size=9), st.sampled_from([0.0, 0.3, 1.0]), st.booleans()
)
@settings(max_examples=40, deadline=None)
def test_flows_are_never_negative_and_seen_ones_never_touched(seed, blind, broken, guessed):
    random = np.random.default_rng(seed)
    context = without(blind)
    works = random.random(NETWORK.slot_mask.shape) >= broken
    context = replace(context, sensors=context.sensors & works)
    roads = Roads.of(context)
    inflow = random.exponential(0.1, NETWORK.slot_mask.shape) * NETWORK.slot_mask
    inflow *= random.random(inflow.shape) < 0.7
    turns = UncountedTurns.of(context, roads)
    there = context.sensors[NETWORK.slot_mask]
    assert (turns is None) == (there.all() or not there.any())
    if turns is None:
        return
    fitted = turns.fitted(inflow, guessed)
    assert np.isfinite(fitted).all()
    assert (fitted >= 0).all()
    assert (fitted[context.sensors] == inflow[context.sensors]).all()
    fed = roads.fed & turns.slots
    assert by_road(roads, fitted * fed) == pytest.approx(by_road(roads, inflow * fed))


def test_counts_that_are_told_stay_as_they_are():
    context = without([CENTRE])
    roads = Roads.of(context)
    assert UncountedTurns.of(replace(context, counted=True), roads) is None
    assert UncountedTurns.of(context, roads) is not None


def test_a_turn_that_no_sensor_sees_has_what_was_told():
    """Else whoever goes straight on would be taken not to be there, and never be served."""
    works = NETWORK.slot_mask.copy()
    works[:, 1::3] = False
    told = replace(CONTEXT, sensors=works, turning_flows=100.0 * NETWORK.lane_parts)
    roads = Roads.of(told)
    turns = UncountedTurns.of(told, roads)
    inflow = told.turning_flows / 3600.0
    outside = ~roads.fed & NETWORK.slot_mask & ~works
    for _ in range(50):
        inflow = turns.fitted(inflow, guessed=False)
    assert inflow[outside] == pytest.approx(100.0 / 3600.0, rel=1e-3)


def test_guesses_of_what_comes_from_outside_pull_little():
    """Learned from in every step, as the traffic model does, they end near what is elsewhere."""
    context = without([0])
    roads = Roads.of(context)
    turns = UncountedTurns.of(context, roads)
    elsewhere, guess, memory = 0.03, 0.3, 0.05
    inflow = np.where(context.sensors, elsewhere, guess) * NETWORK.slot_mask
    outside = ~roads.fed & turns.slots
    for _ in range(400):
        learned = inflow + memory * (guess - inflow)
        inflow = turns.fitted(np.where(outside, learned, inflow), guessed=True)
    total = by_road(roads, inflow * outside)[np.unique(roads.road[outside])]
    assert total == pytest.approx(3 * (elsewhere + 0.0476 * (guess - elsewhere)), rel=0.02)
