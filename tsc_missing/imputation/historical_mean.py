"""Imputation by the mean of what was reported so far."""

import numpy as np

from tsc_missing.controllers.base import ControlContext
from tsc_missing.imputation.base import Imputer
from tsc_missing.imputation.memory import LastReported, turn_means
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.sensing.observation import N_FEATURES, Observation


class HistoricalMean(Imputer):
    """A missing slot takes the mean of all values that it reported since the run began.

    One that never reported takes the mean of these over the slots of the same turn that did, 0 if
    none did.
    """

    def reset(self, context: ControlContext) -> None:
        """Forget everything and get ready for a run on the context's network."""
        shape = (context.network.n, N_SLOTS)
        self._there = context.network.slot_mask
        self._reports = np.zeros(shape, dtype=np.int64)
        self._sums = np.zeros((*shape, N_FEATURES))
        self._exits = LastReported(shape)

    def fill(self, observation: Observation) -> Observation:
        """The observation with finite values everywhere; what was reported stays as it was."""
        reported = observation.mask[:, :, None]
        self._reports += observation.mask
        self._sums += np.where(reported, observation.values, 0.0)
        ever = self._reports > 0
        means = self._sums / np.maximum(self._reports, 1)[:, :, None]
        usual = turn_means(means, ever & self._there)
        estimate = np.where(ever[:, :, None], means, usual)
        return observation.filled(
            np.where(reported, observation.values, estimate),
            self._exits.update(observation.exits, observation.mask),
        )
