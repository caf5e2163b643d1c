"""Random phases: a floor for comparisons, and a controller for tests."""

import numpy as np

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.network.model import IntArray
from tsc_missing.seeding import stream
from tsc_missing.sensing.observation import Observation


class RandomPhases(Controller):
    """Each intersection takes one of its phases at random at every step, all alike probable."""

    needs_values = False

    def reset(self, context: ControlContext) -> None:
        """Start the run's own stream of random numbers."""
        self._phase_mask = context.network.phase_mask
        self._random = stream(context.seed, "random-phases")

    def decide(self, observation: Observation) -> IntArray:
        """(N,): random phases that the intersections have."""
        draws = self._random.random(self._phase_mask.shape)
        phases: IntArray = np.where(self._phase_mask, draws, -1.0).argmax(axis=1).astype(np.int64)
        return phases
