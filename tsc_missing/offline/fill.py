"""Logs with holes, filled as an imputer would have filled them in the run."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tsc_missing.config import SignalSettings
from tsc_missing.controllers.base import ControlContext
from tsc_missing.imputation.base import Imputer
from tsc_missing.network.model import BoolArray, IntArray, Network
from tsc_missing.offline.log import EpisodeLog, Float32Array
from tsc_missing.sensing.observation import Measurement, Observation, apply_mask


def fill_log(log: EpisodeLog, network: Network, imputer: Imputer) -> EpisodeLog:
    """The log with values everywhere; its mask still tells what was recorded.

    The imputer goes through it step by step, so nothing of the future gets into the past.
    """
    if log.mask is None:
        return log
    imputer.reset(replay_context(network, log.mask, seed=0))
    values = np.empty_like(log.values)
    for seen in replay(log.values, log.phase, log.red_steps, log.mask):
        values[seen.step] = imputer.fill(seen).values
    return replace(log, values=values)


def replay_context(network: Network, mask: BoolArray, seed: int) -> ControlContext:
    """What was known before the first step of a log whose sensors had the ``mask`` (T, N, 12)."""
    signals = SignalSettings()
    return ControlContext(
        network=network,
        turning_flows=np.zeros(network.slot_mask.shape),
        sensors=np.asarray(mask.any(axis=0)),
        decision_interval=signals.decision_interval,
        lost_time=signals.yellow,
        min_steps=np.ones(network.n, dtype=np.int64),
        seed=seed,
    )


def replay(
    values: Float32Array, phase: IntArray, red_steps: IntArray, mask: BoolArray
) -> Iterator[Observation]:
    """The T observations that sensors with a ``mask`` (T, N, 12) made of what was logged.

    ``values`` (T, N, 12, F), ``phase`` (T, N) that ran from each step, ``red_steps`` (T, N, 12).
    """
    interval = SignalSettings().decision_interval
    before = np.concatenate((np.full_like(phase[:1], -1), phase[:-1]))
    for step, ran in enumerate(before):
        truth = Measurement(values[step].astype(float), np.zeros(mask[step].shape))
        yield apply_mask(truth, mask[step], step, step * interval, ran, red_steps[step])
