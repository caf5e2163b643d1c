"""Running on a plan where nothing is seen."""

import numpy as np

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.wrapper import Wrapper
from tsc_missing.network.model import BoolArray, IntArray, Network
from tsc_missing.network.slots import APPROACHES, TURNS
from tsc_missing.sensing.observation import Observation

STALE_STEPS = 8  # two minutes at a decision every 15 s: longer than most cycles


class Blind(Wrapper):
    """A controller that leaves intersections without information to a fixed cycle.

    An intersection is blind if none of its slots has a sensor, or if none has reported for more
    than ``stale_steps`` steps. All of them are left to the cycle; but with ``familiar`` only those
    unlike what the packaged weights learned on, with ``clustered`` only those where an adjacent
    intersection is blind too (else all around tells what may be there), with ``alone`` only those
    that have no adjacent intersection, and with several those of any of these kinds.

    The cycle is asked at every step and keeps its own time, so that an outage enters the plan where
    it stands (plans of neighbours stay coordinated) and never begins it anew; the inner controller
    is asked at every step too, so that its memory is unbroken when sensors come back.
    """

    def __init__(
        self,
        controller: Controller,
        cycle: Controller,
        stale_steps: int = STALE_STEPS,
        clustered: bool = False,
        familiar: bool = False,
        alone: bool = False,
    ) -> None:
        """``cycle`` decides at blind intersections; it must not need values."""
        super().__init__(controller)
        self.cycle = cycle
        self._clustered = clustered
        self._familiar = familiar
        self._alone = alone
        self._stale_steps = stale_steps

    def reset(self, context: ControlContext) -> None:
        """Reset both, and count every intersection as just seen."""
        self._slots = context.network.slot_mask
        self._adjacent = context.network.adjacency
        self._unlike = ~learned_kind(context.network)
        self._equipped = (context.sensors & self._slots).any(axis=1)
        self._silent = np.zeros(context.network.n, dtype=np.int64)
        super().reset(context)
        self.cycle.reset(context)

    def decide(self, observation: Observation) -> IntArray:
        """(N,): the cycle's phases at blind intersections, the controller's elsewhere."""
        seen = (observation.mask & self._slots).any(axis=1)
        self._silent = np.where(seen, 0, self._silent + 1)
        blind = ~self._equipped | (self._silent > self._stale_steps)
        left = blind & self._left(blind)
        return np.where(left, self.cycle.decide(observation), self.controller.decide(observation))

    def _left(self, blind: BoolArray) -> BoolArray:
        """(N,): the intersections that are left to the cycle if they are ``blind`` (N,)."""
        left = np.full(len(blind), not (self._familiar or self._clustered or self._alone))
        if self._familiar:
            left |= self._unlike
        if self._clustered:
            left |= (self._adjacent & blind).any(axis=1)
        if self._alone:
            left |= ~self._adjacent.any(axis=1)
        return left


def learned_kind(network: Network) -> BoolArray:
    """(N,): the intersections of the kind that the packaged diffusion weights learned on.

    Those of the six datasets: traffic from four sides, no movement that shares a lane, and an
    adjacent intersection, whose sensors tell of it.
    """
    by_side = network.slot_mask.reshape(network.n, len(APPROACHES), len(TURNS))
    four_sides = np.all(by_side.any(axis=2), axis=1)
    alone = ~network.adjacency.any(axis=1)
    return np.asarray(four_sides & ~network.shares_lanes.any(axis=1) & ~alone)
