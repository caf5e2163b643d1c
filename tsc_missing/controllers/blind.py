"""Running on a plan where nothing is seen."""

import numpy as np

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.wrapper import Wrapper
from tsc_missing.network.model import IntArray
from tsc_missing.sensing.observation import Observation

STALE_STEPS = 8  # two minutes at a decision every 15 s: longer than most cycles


class Blind(Wrapper):
    """A controller that leaves intersections without information to a fixed cycle.

    An intersection is blind if none of its slots has a sensor, or if none has reported for more
    than ``stale_steps`` steps; where ``clustered``, it is left to the cycle only if one of its
    adjacent intersections is blind too, or it has none: else all around it tells what may be there.
    The cycle is asked at
    every step and keeps its own time, so that an outage enters the plan where it stands (plans of
    neighbours stay coordinated) and never begins it anew; the inner controller is asked at every
    step too, so that its memory is unbroken when sensors come back.
    """

    def __init__(
        self,
        controller: Controller,
        cycle: Controller,
        stale_steps: int = STALE_STEPS,
        clustered: bool = False,
    ) -> None:
        """``cycle`` decides at blind intersections; it must not need values."""
        super().__init__(controller)
        self.cycle = cycle
        self._clustered = clustered
        self._stale_steps = stale_steps

    def reset(self, context: ControlContext) -> None:
        """Reset both, and count every intersection as just seen."""
        self._slots = context.network.slot_mask
        self._adjacent = context.network.adjacency
        self._equipped = (context.sensors & self._slots).any(axis=1)
        self._silent = np.zeros(context.network.n, dtype=np.int64)
        super().reset(context)
        self.cycle.reset(context)

    def decide(self, observation: Observation) -> IntArray:
        """(N,): the cycle's phases at blind intersections, the controller's elsewhere."""
        seen = (observation.mask & self._slots).any(axis=1)
        self._silent = np.where(seen, 0, self._silent + 1)
        blind = ~self._equipped | (self._silent > self._stale_steps)
        if self._clustered:
            alone = ~self._adjacent.any(axis=1)
            blind &= alone | (self._adjacent & blind).any(axis=1)
        return np.where(blind, self.cycle.decide(observation), self.controller.decide(observation))
