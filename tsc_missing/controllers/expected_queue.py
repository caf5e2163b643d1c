"""Serving the longest queue that turning counts let expect, for intersections that see nothing."""

import numpy as np

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.fixed_time import SATURATION_FLOW
from tsc_missing.controllers.scores import best_phases, phase_scores
from tsc_missing.network.model import FloatArray, IntArray
from tsc_missing.seeding import stream
from tsc_missing.sensing.observation import Observation

NAME = "expected-queue"


class ExpectedQueue(Controller):
    """Max-queue on queues that follow from turning counts and the signals alone.

    With the flow f [vehicles/s] of a slot, its n lanes, the saturation flow s [vehicles/s/lane]
    and its green time g in a step of Δ seconds (Δ less the lost time in the first),

        q ← max(0, q + f Δ - s n g)

    Nothing that a sensor reports is used.
    """

    needs_values = False

    def __init__(self, spread: float = 0.0) -> None:
        """``spread``: standard deviation of the logarithm of an error in the flows, for variety."""
        self._spread = spread

    def reset(self, context: ControlContext) -> None:
        """Begin without queues."""
        network = context.network
        errors = stream(context.seed, NAME).normal(0.0, 1.0, network.slot_mask.shape)
        hourly = context.turning_flows * np.exp(self._spread * errors)
        self._network = network
        self._arrivals = hourly / 3600.0 * context.decision_interval
        self._per_second = SATURATION_FLOW / 3600.0 * network.slot_lane_count
        self._times = context.decision_interval, context.lost_time
        self._queue: FloatArray = np.zeros(network.slot_mask.shape)
        self._was_green = np.zeros(network.slot_mask.shape, dtype=bool)

    def decide(self, observation: Observation) -> IntArray:
        """(N,): the phase with the longest expected queues; ties go to the lowest."""
        green = observation.red_steps == 0
        interval, lost = self._times
        seconds = np.where(green, np.where(self._was_green, interval, interval - lost), 0.0)
        if observation.step > 0:
            left = self._queue + self._arrivals - self._per_second * seconds
            self._queue = np.maximum(left, 0.0)
        self._was_green = green
        return best_phases(phase_scores(self._network, self._queue), NAME)
