import numpy as np
import pytest

pytest.importorskip("torch", reason="Q-networks need torch")

from tests.networks import grid_network
from tsc_missing.offline.log import EpisodeLog, red_steps_of
from tsc_missing.qlearning.config import QLearningSettings
from tsc_missing.qlearning.rewards import departures, rewards

GRID = grid_network(2, 2)


def made_up(steps=200, seed=0):
    """Known arrivals and departures; (log, departures (T - 1, N) of slots that are not free)."""
    rng = np.random.default_rng(seed)
    phase = rng.integers(0, 4, (steps, GRID.n))
    red = red_steps_of(GRID, phase)
    vehicles = np.zeros((steps, GRID.n, 12))
    left = np.zeros((steps - 1, GRID.n, 12))
    for t in range(steps - 1):
        green = red[t + 1] == 0
        left[t] = np.minimum(vehicles[t], 6) * green
        vehicles[t + 1] = vehicles[t] - left[t] + rng.poisson(1.0, (GRID.n, 12))
    values = np.stack((vehicles, np.minimum(vehicles, 3)), axis=-1).astype(np.float32)
    return EpisodeLog(values, phase, red, None), (left * ~GRID.free_slots).sum(axis=2)


def test_departures_are_told_without_bias_and_with_less_noise_than_the_vehicles():
    log, truth = made_up()
    found = departures(log, GRID)
    assert found.shape == truth.shape
    error = found - truth
    assert abs(error.mean()) < 0.1
    assert error.std() < 1.6  # two green slots with one arrival a step each
    assert np.corrcoef(found.ravel(), truth.ravel())[0, 1] > 0.9


@pytest.mark.parametrize("weight", [0.0, 0.5, 1.0])
def test_vehicles_on_the_entrance_lanes(weight):
    log, _ = made_up(20)
    settings = QLearningSettings(
        algorithm="value", nets=("x",), running_weight=weight, reward_scale=10.0
    )
    found = rewards(log, GRID, settings)
    for t in range(19):
        vehicles, queue = log.values[t + 1].sum(axis=1).T
        wanted = -(queue + weight * (vehicles - queue)) / 10
        np.testing.assert_allclose(found[t], wanted, rtol=1e-5)
