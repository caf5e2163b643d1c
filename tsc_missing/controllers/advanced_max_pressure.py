"""Advanced max-pressure: keep the green while enough vehicles are about to use it."""

import math

import numpy as np

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.scores import best_phases, downstream_mean, phase_scores
from tsc_missing.network.model import FloatArray, IntArray, Network
from tsc_missing.network.records import LaneRecord
from tsc_missing.sensing.observation import QUEUE, VEHICLES, Observation

NAME = "advanced-max-pressure"


class AdvancedMaxPressure(Controller):
    """Advanced-MP of Zhang et al. (ICML 2022, "Expression might be enough", arXiv 2112.10107).

    For a movement m with the entrance lanes l and the lanes k of its exit road,

        pressure(m) = mean_l queue(l) - mean_k queue(k)      ("efficient pressure")
        demand(m)   = vehicles that run within reach of the stop line  ("effective running")

    where the reach is the speed limit times the decision interval (11.1 m/s, 15 s: 167 m). The
    current phase stays if the sum of its movements' demand is at least the largest sum of
    pressures of any phase (the method's weight of 1); else the phase with the largest follows.

    Vehicles = queueing + running; where along the part that its sensor covers a vehicle runs is not
    known. The running ones count as spread evenly: demand = running * min(1, reach / length), where
    length is that of the lane, or of a shorter detector. Exit lanes that lead to no signal have no
    queue. Needs complete values; ``decide`` raises ``ValueError`` on a hole.
    """

    def reset(self, context: ControlContext) -> None:
        """Take the network and how much of each slot's lanes is within reach."""
        self._network = context.network
        self._in_reach = share_in_reach(
            context.network, context.decision_interval, context.detector_length
        )

    def decide(self, observation: Observation) -> IntArray:
        """(N,): the current phase where its demand is enough, else that of largest pressure."""
        network = self._network
        queue = observation.values[:, :, QUEUE]
        running = np.maximum(observation.values[:, :, VEHICLES] - queue, 0.0)
        upstream = queue / np.maximum(network.slot_lane_count, 1)
        pressure = phase_scores(
            network, upstream - downstream_mean(network, queue, np.zeros_like(queue))
        )
        demand = phase_scores(network, running * self._in_reach)
        current = observation.phase
        kept = np.where(current >= 0, demand[np.arange(network.n), current], -np.inf)
        best = best_phases(pressure, NAME)
        return np.where(kept >= pressure.max(axis=1), current, best)


def share_in_reach(
    network: Network, interval: float, detector_length: float | None = None
) -> FloatArray:
    """(N, 12): the part of what a slot's sensors cover that a free vehicle passes in ``interval``.

    ``interval`` [s]; ``detector_length`` [m], None where whole lanes are covered.
    """
    longest = math.inf if detector_length is None else detector_length

    def share(lane: LaneRecord) -> float:
        return min(1.0, lane.speed * interval / min(lane.length, longest))

    lanes = network.record.lanes
    return np.array(
        [
            [np.mean([share(lanes[k]) for k in slot]) if slot else 0.0 for slot in slots]
            for slots in network.slot_lanes
        ]
    )
