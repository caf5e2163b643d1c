"""Tiny weights, runs of observations with holes, and networks in another order."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from tests.diffusion.cases import model
from tsc_missing.controllers.planner import Planner
from tsc_missing.diffusion.weights import save_weights
from tsc_missing.network.model import Network
from tsc_missing.sensing.observation import Measurement, Observation, apply_mask

STEPS = 8


def save_tiny(path: Path) -> Path:
    save_weights(model(), path, {})
    return path


def save_broken(path: Path) -> Path:
    """Weights that load and give NaN."""
    broken = model()
    with torch.no_grad():
        next(broken.noise_model.parameters()).fill_(torch.nan)
    save_weights(broken, path, {})
    return path


def observations(network: Network, poison: float | None = None) -> Iterator[Observation]:
    """STEPS observations of which half is missing, ``poison`` in the place of what is."""
    random = np.random.default_rng(3)
    red = np.where(network.free_slots, 0, 1)
    for step in range(STEPS):
        phase = random.integers(0, network.phase_mask.sum(axis=1))
        values = random.integers(0, 30, (*network.slot_mask.shape, 2)) * 1.0
        exits = random.integers(0, 9, network.slot_mask.shape) * 1.0
        mask = (random.random(network.slot_mask.shape) < 0.5) | ~network.slot_mask
        truth = Measurement(values * network.slot_mask[:, :, None], exits)
        observation = apply_mask(truth, mask, step, 15.0 * step, phase, red)
        if poison is not None:
            hidden = np.where(mask[:, :, None], observation.values, poison)
            observation = replace(observation, values=hidden)
        yield observation
        green = network.phases[np.arange(network.n), phase] | network.free_slots
        red = np.where(green, 0, red + 1)


def reordered(network: Network, order: np.ndarray) -> Network:
    """The same network with its intersections in another order."""
    nodes = tuple(network.intersections[n] for n in order)
    return Network("reordered", network.record.model_copy(update={"intersections": nodes}))


def taken(observation: Observation, order: np.ndarray) -> Observation:
    """The observation of the network in that order."""
    names = ("values", "exits", "mask", "reward", "phase", "red_steps")
    return replace(observation, **{name: getattr(observation, name)[order] for name in names})


def reorder_noise(planner: Planner, order: np.ndarray) -> None:
    """Let the planner's noise come in that order."""
    draw = planner.model.initial_noise
    planner.model.initial_noise = lambda *given: draw(*given)[torch.from_numpy(order)]
