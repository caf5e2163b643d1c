"""Logs with holes, filled as an imputer would have filled them in the run."""

from dataclasses import replace

import numpy as np

from tsc_missing.config import SignalSettings
from tsc_missing.controllers.base import ControlContext
from tsc_missing.imputation.base import Imputer
from tsc_missing.network.model import Network
from tsc_missing.offline.log import EpisodeLog
from tsc_missing.sensing.observation import Measurement, apply_mask


def fill_log(log: EpisodeLog, network: Network, imputer: Imputer) -> EpisodeLog:
    """The log with values everywhere; its mask still tells what was recorded.

    The imputer goes through it step by step, so nothing of the future gets into the past.
    """
    if log.mask is None:
        return log
    interval = SignalSettings().decision_interval
    imputer.reset(
        ControlContext(
            network=network,
            turning_flows=np.zeros(network.slot_mask.shape),
            sensors=np.asarray(log.mask.any(axis=0)),
            decision_interval=interval,
            lost_time=SignalSettings().yellow,
            seed=0,
        )
    )
    values = np.empty_like(log.values)
    phases = np.concatenate((np.full_like(log.phase[:1], -1), log.phase[:-1]))
    for step, (mask, phase) in enumerate(zip(log.mask, phases, strict=True)):
        truth = Measurement(log.values[step].astype(float), np.zeros(mask.shape))
        seen = apply_mask(truth, mask, step, step * interval, phase, log.red_steps[step])
        values[step] = imputer.fill(seen).values
    return replace(log, values=values)
