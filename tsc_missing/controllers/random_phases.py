"""Random phases: a floor for comparisons, and a controller for tests."""

import numpy as np

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.network.model import IntArray
from tsc_missing.seeding import stream
from tsc_missing.sensing.observation import Observation

SPREAD = 1.2  # of the logarithm of how probable a skewed phase is


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


class SkewedPhases(RandomPhases):
    """Phases at random that are not alike probable: some of an intersection come seldom.

    Their shares are drawn once, e^z with z of variance ``SPREAD``² before they are made to add
    up to 1.
    """

    def reset(self, context: ControlContext) -> None:
        """Draw how often each phase comes."""
        super().reset(context)
        draws = np.exp(self._random.normal(0.0, SPREAD, self._phase_mask.shape))
        weights = np.where(self._phase_mask, draws, 0.0)
        self._shares = np.cumsum(weights / weights.sum(axis=1, keepdims=True), axis=1)

    def decide(self, observation: Observation) -> IntArray:
        """(N,): random phases that the intersections have."""
        draws = self._random.random((len(self._shares), 1)) * self._shares[:, -1:]
        phases: IntArray = (draws >= self._shares).sum(axis=1).astype(np.int64)
        return phases
