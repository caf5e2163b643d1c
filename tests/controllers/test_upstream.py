"""Who leaves upstream enters the right roads, and nobody is lost or counted twice."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.controllers.helpers import A, B, context, cross_and_tee, slot
from tests.networks import context_for, grid_network
from tsc_missing.controllers.upstream import Roads

NETWORK = cross_and_tee()


def leaving(n, name, vehicles=1.0):
    out = np.zeros((1, *NETWORK.slot_mask.shape))
    out[0, n, slot(name)] = vehicles
    return out


def test_a_slot_feeds_the_road_that_it_leads_to():
    roads = Roads.of(context(NETWORK))
    entering = roads.entering(leaving(A, "W-straight", 4.0))[0]
    west = [slot(f"W-{turn}") for turn in ("straight", "right")]
    assert entering[B, west].tolist() == [4.0, 4.0]  # of the road; turns share it out
    assert roads.fed[B, west].all()
    assert not roads.fed[B, slot("S-left")]
    assert not entering[A].any()


@given(st.integers(0, 10**6))
@settings(max_examples=20, deadline=None)
def test_nobody_is_lost_between_signals(seed):
    network = grid_network(2, 3)
    random = np.random.default_rng(seed)
    roads = Roads.of(replace(context_for(network), turning_flows=random.uniform(0, 9, (6, 12))))
    out = random.uniform(0, 2, (3, *network.slot_mask.shape)) * network.slot_mask
    inflow = random.uniform(0, 1, network.slot_mask.shape) * network.slot_mask
    entered = roads.entering(out) * roads.shares(inflow)
    onward = (network.downstream >= 0).any(axis=2)
    assert entered.sum() == pytest.approx(out[:, onward].sum())
    assert not entered[:, ~roads.fed].any()


def test_a_slot_that_leads_to_two_roads_is_split_by_their_counts():
    upstream = dict(NETWORK.record.upstream)
    upstream["eB"] = upstream["AB"]  # through a junction without a signal
    record = NETWORK.record.model_copy(update={"upstream": upstream})
    network = replace(NETWORK, record=record)
    flows = {(B, "W-straight"): 299.0, (B, "E-straight"): 99.0}
    roads = Roads.of(replace(context(NETWORK, flows), network=network))
    entering = roads.entering(leaving(A, "W-straight", 4.0))[0, B]
    assert entering[slot("W-straight")] == pytest.approx(3.0)
    assert entering[slot("E-straight")] == pytest.approx(1.0)


def test_two_roads_of_one_approach_share_nothing():
    lanes = dict(NETWORK.record.lanes)
    lanes["nA_2"] = lanes["nA_2"].model_copy(update={"road": "other"})
    record = NETWORK.record.model_copy(update={"lanes": lanes})
    roads = Roads.of(context(replace(NETWORK, record=record)))
    inflow = np.ones_like(NETWORK.slot_mask, dtype=float)
    shares = roads.shares(inflow * NETWORK.slot_mask)[A]
    assert shares[slot("N-left")] == 1.0
    assert shares[slot("N-straight")] == 0.5
    assert shares[STRAIGHT] == pytest.approx(1 / 3)


STRAIGHT = slot("W-straight")


def test_detectors_of_the_last_metres_are_told_by_no_signal():
    assert not Roads.of(replace(context(NETWORK), detector_length=50.0)).fed.any()
