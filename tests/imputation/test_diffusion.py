from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch", reason="the diffusion imputer needs torch")

from tests.controllers.helpers import cross_and_tee
from tests.controllers.planning import (
    STEPS,
    observations,
    reorder_noise,
    reordered,
    save_broken,
    save_tiny,
    taken,
)
from tests.networks import context_for, grid_network, tee_network
from tsc_missing.controllers.check import check_controller
from tsc_missing.controllers.difflight import DiffLight
from tsc_missing.controllers.fallback import Safe
from tsc_missing.controllers.max_pressure import MaxPressure
from tsc_missing.controllers.max_queue import MaxQueue
from tsc_missing.imputation.base import Imputed
from tsc_missing.imputation.diffusion import DiffusionImputer

GRID = grid_network(2, 3)
TEE = tee_network()


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    return save_tiny(tmp_path_factory.mktemp("weights") / "tiny")


def fill(imputer, network, poison=None, seed=0):
    imputer.reset(context_for(network, seed))
    return [imputer.fill(observation) for observation in observations(network, poison)]


@pytest.mark.parametrize("network", [GRID, TEE, grid_network(1, 1)], ids=["grid", "tee", "single"])
def test_reported_values_stay_and_the_rest_is_finite(weights, network):
    for given, filled in zip(
        observations(network), fill(DiffusionImputer(weights, 2), network), strict=True
    ):
        seen = given.mask
        np.testing.assert_array_equal(filled.values[seen], given.values[seen])
        np.testing.assert_array_equal(filled.exits[seen], given.exits[seen])
        np.testing.assert_array_equal(filled.mask, seen)
        assert np.isfinite(filled.values).all()
        assert np.isfinite(filled.exits).all()
        assert (filled.values >= 0).all()
        assert not filled.values[~network.slot_mask].any()
        assert np.allclose(filled.reward, -filled.values[..., 1].sum(axis=1))


@pytest.mark.parametrize("poison", [1e9, -np.inf, 0.0])
def test_what_is_under_the_mask_changes_nothing(weights, poison):
    imputer = DiffusionImputer(weights, 2)
    for plain, poisoned in zip(fill(imputer, TEE), fill(imputer, TEE, poison), strict=True):
        np.testing.assert_array_equal(plain.values, poisoned.values)


def test_a_reported_nan_is_filled(weights):
    imputer = DiffusionImputer(weights, 2)
    imputer.reset(context_for(GRID))
    for observation in observations(GRID):
        observation.values[0, 1] = np.nan
        assert np.isfinite(imputer.fill(observation).values).all()


def test_reset_forgets_and_takes_the_seed(weights):
    imputer = DiffusionImputer(weights, 2)
    first, again, other = (fill(imputer, GRID, seed=seed)[-1].values for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_permuting_intersections_permutes_the_values(weights):
    order = np.array([2, 5, 0, 1, 4, 3])
    plain, other = (DiffusionImputer(weights, 2) for _ in range(2))
    plain.reset(context_for(GRID))
    other.reset(context_for(reordered(GRID, order)))
    reorder_noise(other._planner, order)
    for observation in observations(GRID):
        values = plain.fill(observation).values
        moved = other.fill(taken(observation, order)).values
        np.testing.assert_allclose(moved, values[order], atol=1e-3)


def test_exits_keep_the_last_report(weights):
    imputer = DiffusionImputer(weights, 1)
    imputer.reset(context_for(GRID))
    first, second, *_ = observations(GRID)
    silent = replace(
        second,
        values=np.full_like(second.values, np.nan),
        exits=np.full_like(second.exits, np.nan),
        mask=~GRID.slot_mask,
    )
    imputer.fill(first)
    filled = imputer.fill(silent)
    np.testing.assert_array_equal(filled.exits[first.mask], first.exits[first.mask])
    assert not filled.exits[~first.mask].any()


@pytest.mark.parametrize("rule", [MaxQueue, MaxPressure])
def test_under_a_rule_it_conforms(weights, rule):
    check_controller(lambda: Imputed(DiffusionImputer(weights, 1), rule()), cross_and_tee())


def test_it_is_not_asked_for_rewards(weights):
    """The controller's present, made with rewards asked for, is another one."""
    controller = DiffLight(weights, 2)
    controller.reset(context_for(GRID))
    for observation in observations(GRID):
        controller.decide(observation)
    estimates = controller.estimates()
    assert not np.allclose(fill(DiffusionImputer(weights, 2), GRID)[-1].values, estimates)


def test_a_broken_model_is_answered_for_and_counted(tmp_path):
    broken = DiffusionImputer(save_broken(tmp_path / "broken"), 2)
    safe = Safe(Imputed(broken, MaxQueue()), deadline_s=60)
    safe.reset(context_for(GRID))
    for observation in observations(GRID):
        assert GRID.phase_mask[np.arange(GRID.n), safe.decide(observation)].all()
    assert safe.fallback_steps == STEPS * GRID.n
