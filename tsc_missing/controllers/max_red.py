"""A bound on how long somebody may wait at a red."""

import numpy as np

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.recent import reported
from tsc_missing.controllers.scores import overruled
from tsc_missing.controllers.spillback import lane_share
from tsc_missing.controllers.wrapper import Wrapper
from tsc_missing.network.model import IntArray
from tsc_missing.sensing.observation import Observation

FEW = 0.5  # [vehicles] on a lane; where fewer are believed to be, it counts as empty for now
UNSURE = 0.5  # what a step of red weighs where nobody is believed to be, and no sensor says so


def bounded(controller: Controller, max_red: float) -> Controller:
    """The controller with a maximum red [s], or as it is where that is 0."""
    return MaxRed(controller, max_red) if max_red else controller


class MaxRed(Wrapper):
    """A controller that serves every movement in time, as maximum red does in signal controllers.

    Who looks for the longest queues lets a single vehicle wait for as long as others have two.
    Here a slot has waited since it last had green or was seen to be empty: a sensor that is silent
    starts nothing anew. Steps in which it is, and in which the controller believes fewer than
    ``FEW`` to be there, count by ``UNSURE``, since beliefs may be wrong for long. A slot is overdue
    when it will have waited for longer than the maximum at the end of the coming step. Where slots
    are overdue, the phase with the most overdue waiting is next, whatever the controller says;
    among equal ones the controller's own. Several slots may be overdue at once and only one phase
    runs, so a red can last some steps longer. Steps in which it was not asked count as waiting.
    """

    def __init__(self, controller: Controller, max_red: float) -> None:
        """``max_red`` [s], above 0."""
        super().__init__(controller)
        self._max_red = max_red

    def reset(self, context: ControlContext) -> None:
        """Reset the controller and take the network."""
        self._network = context.network
        self._interval = context.decision_interval
        served = context.network.phases.any(axis=1)
        self._bound = served & context.network.slot_mask & ~context.network.free_slots
        self._few = FEW * lane_share(context.network)
        self._waited = np.zeros(context.network.slot_mask.shape)  # [decision steps]
        self._step = -1  # when it was last asked
        super().reset(context)

    def decide(self, observation: Observation) -> IntArray:
        """(N,): the controller's phases but where a slot is overdue."""
        phases = self.controller.decide(observation)
        seen, vehicles = reported(observation), self.believed_vehicles(observation)
        empty = seen & (vehicles <= 0)
        unsure = ~seen & (vehicles < self._few)
        since = np.where(unsure, UNSURE, 1.0) * (observation.step - self._step)
        self._waited = np.where(empty, 0.0, np.minimum(self._waited + since, observation.red_steps))
        self._step = observation.step
        waited = self._waited * self._interval  # (N, 12) [s] until now
        overdue = self._bound & (waited + self._interval > self._max_red)
        return overruled(self._network, phases, np.where(overdue, waited, 0.0))
