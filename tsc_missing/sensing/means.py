"""Long-run means of what sensors told and of the greens: the memory beyond the last few steps."""

import numpy as np
import numpy.typing as npt

from tsc_missing.network.model import BoolArray, FloatArray
from tsc_missing.sensing.observation import N_FEATURES

GREEN, KNOWN = N_FEATURES, N_FEATURES + 1  # columns of a table, after the features
N_MEANS = N_FEATURES + 2


class RunningMeans:
    """Means over the last readings of each slot, the older the less they count.

    A slot's first ``steps`` readings count alike; after them each weighs 1 / ``steps`` and takes
    that part of the weight of those before it.
    """

    def __init__(self, shape: tuple[int, ...], steps: int) -> None:
        """Nothing was read yet of slots in an array of this ``shape``."""
        self._values: FloatArray = np.zeros((*shape, N_FEATURES))
        self._green: FloatArray = np.zeros(shape)
        self._readings = np.zeros(shape)
        self._taken = 0
        self._steps = steps

    def take(self, values: FloatArray, known: BoolArray, green: BoolArray) -> None:
        """Take in a step: ``values`` (…, F) [vehicles], where ``known`` (…), and ``green`` (…)."""
        self._readings += known
        weight = known / np.clip(self._readings, 1, self._steps)
        found = np.where(known[..., None], values, 0.0)
        self._values += weight[..., None] * (found - self._values)
        self._taken += 1
        self._green += (green - self._green) / min(self._taken, self._steps)

    def table(self) -> npt.NDArray[np.float32]:
        """(…, F + 2): the means of the features [vehicles] and of green, and 1 for any reading."""
        known = (self._readings > 0).astype(float)
        parts = (self._values, self._green[..., None], known[..., None])
        return np.concatenate(parts, axis=-1).astype(np.float32)
