"""What imputers keep of the past, and the mean that stands in where there is none."""

import numpy as np

from tsc_missing.network.model import BoolArray, FloatArray
from tsc_missing.network.slots import APPROACHES, TURNS


class LastReported:
    """The last reported value of every cell; 0 where nothing was ever reported."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        """For values of this shape."""
        self.values: FloatArray = np.zeros(shape)

    def update(self, values: FloatArray, reported: BoolArray) -> FloatArray:
        """Take in what was ``reported`` and return the last value of each cell."""
        self.values = np.where(reported, values, self.values)
        return self.values


def turn_means(values: FloatArray, known: BoolArray) -> FloatArray:
    """(12, F): for each slot the mean of ``values`` (N, 12, F) over the known slots of its turn.

    0 for a turn of which no slot is ``known`` (N, 12).
    """
    by_turn = (len(known), len(APPROACHES), len(TURNS))
    counts = known.reshape(by_turn).sum(axis=(0, 1))
    seen = np.where(known[:, :, None], values, 0.0)
    sums = seen.reshape(*by_turn, values.shape[-1]).sum(axis=(0, 1))
    return np.tile(sums / np.maximum(counts, 1)[:, None], (len(APPROACHES), 1))
