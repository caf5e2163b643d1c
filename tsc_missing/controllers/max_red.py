"""A bound on the red of movements that somebody may be waiting for."""

import numpy as np

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.scores import overruled
from tsc_missing.controllers.wrapper import Wrapper
from tsc_missing.network.model import IntArray
from tsc_missing.sensing.observation import VEHICLES, Observation


def bounded(controller: Controller, max_red: float) -> Controller:
    """The controller with a maximum red [s], or as it is where that is 0."""
    return MaxRed(controller, max_red) if max_red else controller


class MaxRed(Wrapper):
    """A controller that serves every movement in time, as maximum red does in signal controllers.

    Who looks for the longest queues lets a single vehicle wait for as long as others have two.
    Here a slot is overdue when it will have been red for the maximum at the end of the coming
    step, and a vehicle is on it or its sensor did not report. Where slots are overdue, the phase
    with the most overdue red time is next, whatever the controller says; among equal ones the
    controller's own. Several slots may be overdue at once and only one phase runs, so a red can
    last some steps longer.
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
        super().reset(context)

    def decide(self, observation: Observation) -> IntArray:
        """(N,): the controller's phases but where a slot is overdue."""
        phases = self.controller.decide(observation)
        red = observation.red_steps * self._interval  # (N, 12) [s] until now
        empty = observation.mask & (observation.values[:, :, VEHICLES] <= 0)
        overdue = self._bound & ~empty & (red + self._interval > self._max_red)
        return overruled(self._network, phases, np.where(overdue, red, 0.0))
