"""What lies under a mask cannot matter: other truth there, same decisions."""

import importlib.util
from dataclasses import replace

import numpy as np
import pytest

from tests.networks import S, context_for, grid_network, tee_network
from tsc_missing.controllers.blind import learned_kind
from tsc_missing.controllers.catalogue import CONTROLLERS, LEARNED, needs_values
from tsc_missing.controllers.registry import BLIND, make_controller
from tsc_missing.imputation.registry import IMPUTERS
from tsc_missing.seeding import stream
from tsc_missing.sensing.observation import Measurement, apply_mask

STEPS = 12
MOST = 60  # vehicles on a slot: more than fit on its lane, which has room for 51
BOUNDS = {"max_red": 60, "min_space": 4}  # [s], [vehicles a lane]
POISONS = (0.0, 1e6, np.nan)
NETWORKS = {"grid": grid_network(2, 3), "tee": tee_network()}
needs_torch = pytest.mark.skipif(
    importlib.util.find_spec("torch") is None, reason="Q-networks need torch"
)


def truths(network, seed):
    """Plausible measurements, one a step: zeros at slots that are not there."""
    rng = stream(seed, "truth")
    for _ in range(STEPS):
        values = rng.integers(0, MOST, (network.n, 12, 2)) * network.slot_mask[:, :, None]
        values[..., 1] = np.minimum(values[..., 1], values[..., 0])
        yield Measurement(values.astype(float), rng.integers(0, 9, (network.n, 12)).astype(float))


def random_masks(network):
    return (stream(1, "masks").random((STEPS, network.n, 12)) < 0.5) | ~network.slot_mask


def blind_in_places(network):
    """Two adjacent intersections and one by itself without a report, the others as at random."""
    masks = random_masks(network)
    blind = [0, 1, 5]
    masks[:, blind] = ~network.slot_mask[blind]
    return masks


def decisions(network, controller, masks, poison, sensors=None, beside=False):
    """(STEPS, N): the phases, with ``poison`` added to the truth under the masks.

    ``beside``: it also lies in the observation, where there is no number otherwise.
    """
    flows = stream(2, "flows").uniform(0, 500, network.slot_mask.shape) * network.slot_mask
    context = replace(context_for(network, 0), turning_flows=flows)
    controller.reset(context if sensors is None else replace(context, sensors=sensors))
    phase = np.full(network.n, -1, dtype=np.int64)
    red = np.where(network.free_slots, 0, 1).astype(np.int64)
    chosen = []
    for step, truth in enumerate(truths(network, 0)):
        hidden = ~masks[step]
        values, exits = truth.values.copy(), truth.exits.copy()
        values[hidden] += poison
        exits[hidden] += poison
        spoiled = Measurement(values, exits)
        seen = apply_mask(spoiled, masks[step], step, 15.0 * step, phase, red)
        if beside:
            seen = replace(seen, values=values, exits=exits)
        phase = controller.decide(seen)
        chosen.append(phase)
        green = network.phases[np.arange(network.n), phase] | network.free_slots
        red = np.where(green, 0, red + 1)
    return np.array(chosen)


def check_poison(network, make, masks, sensors=None, beside=False):
    """The same phases, that are there, whatever lies under the masks."""
    plain, *others = (
        decisions(network, make(), masks, poison, sensors, beside) for poison in POISONS
    )
    for other in others:
        np.testing.assert_array_equal(plain, other)
    assert ((plain >= 0) & (plain < network.phase_mask.sum(axis=1))).all()


def check_bounded(network, name, blind):
    """As ``check_poison``, for a controller with both bounds beside blind intersections."""
    masks = blind_in_places(network)
    check_poison(
        network,
        lambda: make_controller(name, "sfm-4", blind, **BOUNDS),
        masks,
        sensors=masks.any(axis=0),
        beside=True,
    )


@pytest.mark.parametrize("network", NETWORKS.values(), ids=NETWORKS)
@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("imputer", IMPUTERS)
@pytest.mark.parametrize("blind", ["none", "fixed-time"])
def test_poison_under_the_mask_changes_no_decision(network, name, imputer, blind):
    masks = random_masks(network)
    check_poison(network, lambda: make_controller(name, imputer, blind), masks)


@pytest.mark.parametrize("network", NETWORKS.values(), ids=NETWORKS)
@pytest.mark.parametrize("name", [n for n in CONTROLLERS if needs_values(n)])
@pytest.mark.parametrize("blind", BLIND)
def test_nor_with_maximum_red_and_room_kept_beside_blind_intersections(network, name, blind):
    """Nor does what lies in an observation itself where its mask says that nothing reported."""
    check_bounded(network, name, blind)


@needs_torch
@pytest.mark.usefixtures("weights_read_once")
@pytest.mark.parametrize("name", LEARNED)
@pytest.mark.parametrize("blind", BLIND)
def test_nor_of_learned_policies(name, blind):
    check_bounded(NETWORKS["tee"], name, blind)


@pytest.mark.parametrize("bound", BOUNDS)
def test_each_bound_overrules_some_of_these_decisions(bound):
    network = NETWORKS["grid"]
    free, bounded = (
        decisions(
            network,
            make_controller("max-queue", "sfm-4", "none", **given),
            blind_in_places(network),
            0,
        )
        for given in ({}, {bound: BOUNDS[bound]})
    )
    assert (free != bounded).any()


def test_each_blind_rule_decides_otherwise():
    network = grid_network(2, 4, closed=[(1, 3, S)])
    masks = random_masks(network)
    blind = [0, 4, 2, 7]  # two side by side, a T-junction by itself, and another by itself
    masks[:, blind] = ~network.slot_mask[blind]
    assert np.flatnonzero(~learned_kind(network)).tolist() == [2]
    found = {
        blind: decisions(
            network,
            make_controller("max-queue", "sfm-4", blind),
            masks,
            0,
            sensors=masks.any(axis=0),
        ).tobytes()
        for blind in BLIND
    }
    assert found["alone"] == found["none"]  # all have neighbours
    assert len(set(found.values())) == len(BLIND) - 1


def test_an_observation_is_nan_wherever_its_mask_is_false():
    network = grid_network(2, 3)
    mask = stream(1, "masks").random((network.n, 12)) < 0.5
    mask[0] = True
    truth = next(truths(network, 0))
    nothing = np.zeros(network.n, dtype=np.int64)
    seen = apply_mask(truth, mask, 0, 0.0, nothing, np.zeros((network.n, 12), dtype=np.int64))
    assert np.isnan(seen.values[~mask]).all()
    assert np.isnan(seen.exits[~mask]).all()
    np.testing.assert_array_equal(seen.values[mask], truth.values[mask])
    np.testing.assert_array_equal(np.isnan(seen.reward), ~mask.all(axis=1))
    assert seen.reward[0] == -truth.values[0, :, 1].sum()
