"""Imputation by the last reported value."""

import numpy as np

from tsc_missing.controllers.base import ControlContext
from tsc_missing.imputation.base import Imputer
from tsc_missing.imputation.memory import LastReported, turn_means
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.sensing.observation import N_FEATURES, Observation


class LastValue(Imputer):
    """A missing slot keeps its last reported value.

    One that never reported takes the mean of what slots of the same turn report now, 0 if none
    does.
    """

    def reset(self, context: ControlContext) -> None:
        """Forget everything and get ready for a run on the context's network."""
        shape = (context.network.n, N_SLOTS)
        self._there = context.network.slot_mask
        self._ever = np.zeros(shape, dtype=bool)
        self._values = LastReported((*shape, N_FEATURES))
        self._exits = LastReported(shape)

    def fill(self, observation: Observation) -> Observation:
        """The observation with finite values everywhere; what was reported stays as it was."""
        reported = observation.mask
        self._ever |= reported
        last = self._values.update(observation.values, reported[:, :, None])
        usual = turn_means(observation.values, reported & self._there)
        return observation.filled(
            np.where(self._ever[:, :, None], last, usual),
            self._exits.update(observation.exits, reported),
        )
