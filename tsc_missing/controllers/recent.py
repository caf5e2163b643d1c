"""The last few observations of a run, with their holes."""

import numpy as np

from tsc_missing.network.model import BoolArray, FloatArray, IntArray
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.sensing.observation import N_FEATURES, Observation


class RecentSteps:
    """The last C observations of N intersections, the newest last.

    Before the first nothing is known, and the signals count as standing as the first shows them.
    """

    def __init__(self, intersections: int, steps: int) -> None:
        """Nothing has been observed yet; ``steps`` is C."""
        shape = (intersections, steps, N_SLOTS)
        self.values: FloatArray = np.full((*shape, N_FEATURES), np.nan)  # NaN where not known
        self.known: BoolArray = np.zeros(shape, dtype=bool)
        self.red_steps: IntArray = np.zeros(shape, dtype=np.int64)  # since the last green
        self._began = False

    @property
    def green(self) -> BoolArray:
        """(N, C, 12): whether the slot has green in the step that ends here."""
        return np.asarray(self.red_steps == 0)

    def take(self, observation: Observation) -> None:
        """Take in the next observation and drop the oldest."""
        known = reported(observation)
        values = np.where(known[:, :, None], observation.values, np.nan)
        if not self._began:
            self.red_steps[:] = observation.red_steps[:, None]
            self._began = True
        self.values = np.concatenate((self.values[:, 1:], values[:, None]), axis=1)
        self.known = np.concatenate((self.known[:, 1:], known[:, None]), axis=1)
        self.red_steps = np.concatenate(
            (self.red_steps[:, 1:], observation.red_steps[:, None]), axis=1
        )


def reported(observation: Observation) -> BoolArray:
    """(N, 12): slots that reported, and numbers; absent slots count as reported."""
    return np.asarray(observation.mask & np.isfinite(observation.values).all(axis=2))
