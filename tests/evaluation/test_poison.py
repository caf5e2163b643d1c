"""What lies under a mask cannot matter: other truth there, same decisions."""

import numpy as np
import pytest

from tests.networks import context_for, grid_network, tee_network
from tsc_missing.controllers.registry import CONTROLLERS, make_controller
from tsc_missing.imputation.registry import IMPUTERS
from tsc_missing.seeding import stream
from tsc_missing.sensing.observation import Measurement, apply_mask

STEPS = 12


def truths(network, seed):
    """Plausible measurements, one a step: zeros at slots that are not there."""
    rng = stream(seed, "truth")
    for _ in range(STEPS):
        values = rng.integers(0, 30, (network.n, 12, 2)) * network.slot_mask[:, :, None]
        values[..., 1] = np.minimum(values[..., 1], values[..., 0])
        yield Measurement(values.astype(float), rng.integers(0, 9, (network.n, 12)).astype(float))


def decisions(network, controller, masks, poison):
    controller.reset(context_for(network, 0))
    phase = np.zeros(network.n, dtype=np.int64)
    red = np.ones((network.n, 12), dtype=np.int64)
    chosen = []
    for step, truth in enumerate(truths(network, 0)):
        hidden = ~masks[step]
        values, exits = truth.values.copy(), truth.exits.copy()
        values[hidden] += poison
        exits[hidden] += poison
        spoiled = Measurement(values, exits)
        phase = controller.decide(apply_mask(spoiled, masks[step], step, 15.0 * step, phase, red))
        chosen.append(phase)
    return np.array(chosen)


@pytest.mark.parametrize("network", [grid_network(2, 3), tee_network()], ids=["grid", "tee"])
@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("imputer", IMPUTERS)
@pytest.mark.parametrize("blind", ["none", "fixed-time"])
def test_poison_under_the_mask_changes_no_decision(network, name, imputer, blind):
    masks = stream(1, "masks").random((STEPS, network.n, 12)) < 0.5
    masks |= ~network.slot_mask
    runs = [
        decisions(network, make_controller(name, imputer, blind), masks, poison)
        for poison in (0.0, 1e6, np.nan)
    ]
    np.testing.assert_array_equal(runs[0], runs[1])
    np.testing.assert_array_equal(runs[0], runs[2])
    assert (runs[0] >= 0).all()


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
