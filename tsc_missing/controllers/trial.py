"""A made-up world of observations with holes, which controllers and imputers are tried on."""

from collections.abc import Iterator
from dataclasses import fields

import numpy as np

from tsc_missing.controllers.base import ControlContext
from tsc_missing.controllers.spillback import lane_share
from tsc_missing.network.model import BoolArray, Network
from tsc_missing.sensing.observation import N_FEATURES, Measurement, Observation

STEPS = 31  # a prime, so that no short cycle of a forgetful reset fits into it
INTERVAL = 15.0  # [s]
LOST_TIME = 5.0  # [s]


def trial_context(network: Network) -> ControlContext:
    """What is known on the network, with turning flows at random and one blind intersection."""
    random = np.random.default_rng(0)
    sensors = np.ones_like(network.slot_mask)
    if network.n > 1:
        sensors[0] = ~network.slot_mask[0]
    return ControlContext(
        network=network,
        turning_flows=random.uniform(0, 500, network.slot_mask.shape) * network.slot_mask,
        sensors=sensors,
        decision_interval=INTERVAL,
        lost_time=LOST_TIME,
        min_steps=np.ones(network.n, dtype=np.int64),
        seed=7,
    )


def trial_world(context: ControlContext) -> Iterator[tuple[Measurement, BoolArray]]:
    """Truth and mask of each step; the middle third of the steps has no report at all."""
    slots, share = context.network.slot_mask, lane_share(context.network)
    random = np.random.default_rng(1)
    for step in range(STEPS):
        reported = context.sensors & (random.random(slots.shape) < 0.5)
        if STEPS // 3 <= step < 2 * STEPS // 3:
            reported = np.zeros_like(slots)
        mask = reported | ~slots
        counts = random.integers(0, 9, (*slots.shape, 3)).astype(np.float64)
        counts *= (slots * share)[:, :, None]
        counts[:, :, 0] += counts[:, :, 1]
        yield Measurement(values=counts[:, :, :N_FEATURES], exits=counts[:, :, N_FEATURES]), mask


def require_unchanged(given: Observation, observation: Observation, words: str) -> None:
    """Raise ``AssertionError`` unless what was ``given`` is as the ``observation`` still."""
    for field in fields(Observation):
        before, after = getattr(observation, field.name), getattr(given, field.name)
        require(
            np.array_equal(before, after, equal_nan=field.name != "mask"),
            f"{words} must not change observation.{field.name}",
        )


def require(condition: bool | np.bool_, words: str) -> None:
    """Raise ``AssertionError`` with words unless the condition holds."""
    if not condition:
        raise AssertionError(words)
