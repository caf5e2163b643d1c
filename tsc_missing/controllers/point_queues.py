"""A traffic model of the roads into signals: who waits at the stop line, and who arrives when."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from tsc_missing.controllers.base import ControlContext
from tsc_missing.network.model import BoolArray, FloatArray, Network
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.sensing.observation import QUEUE, VEHICLES

SUBSTEP = 5.0  # [s] about which the model steps: the yellow of the paper's signals
START_LOSS = 1.5  # [s] of a green until vehicles leave at the saturation headway
YELLOW_USE = 1.0  # [s] of a yellow in which vehicles still leave
APPROACH_LOSS = 4.0  # [s] that a vehicle takes longer to the stop line than at the speed limit


@dataclass(frozen=True)
class Traffic:
    """What the model makes of the last observations, in M samples of what may be.

    ``inflow`` is that of the last steps in the mean; vehicles that are yet to come in are in
    neither of the other two.
    """

    queue: FloatArray  # (M, N, 12) [vehicles] that would be at the stop line now if nobody queued
    arrivals: FloatArray  # (T, M, N, 12) [vehicles] now on the road who reach it in each substep
    inflow: FloatArray  # (M, N, 12) [vehicles/s] that enter the road


class PointQueues:
    """Roads as travel times that end in a queue without length, a slot at a time.

    The point queue of Vickrey (American Economic Review 59, 1969): a vehicle that enters a slot's
    lanes reaches the stop line after the time that they take at the speed limit and
    ``APPROACH_LOSS``, and leaves it in the order of arrival: under green at the saturation headway
    of each lane, but not in the yellow before and ``START_LOSS`` after it; under a yellow that ends
    a green for ``YELLOW_USE``.

    When vehicles entered is told by the counts: inflow = change of the count + outflow, where the
    outflow is the model's own. What it gets wrong does not add up, since in every step
    queue = max(observed queue, observed vehicles - those who are still under way).
    """

    def __init__(self, context: ControlContext, history: int, ahead: int, hold: int) -> None:
        """To look ``ahead`` stages of ``hold`` decision steps on from ``history`` observations.

        A stage is a time in which no signal changes.
        """
        self.network = context.network
        self._interval = context.decision_interval
        self._lost = context.lost_time
        self._history = history
        self._headway = context.headway
        self.substeps = max(1, round(self._interval / SUBSTEP))  # of a decision step
        self.substep = self._interval / self.substeps  # [s]
        self.stage = hold * self.substeps  # substeps of a stage
        self.horizon = ahead * self.stage  # substeps
        self._travel = _travel_time(context)
        self._lanes = _lanes(self.network)
        self._shares = self._arrival_shares()

    def estimate(self, values: FloatArray, green: BoolArray) -> Traffic:
        """The traffic after C observations ``values`` (M, C, N, 12, F) without holes, C >= 2.

        ``green`` (C, N, 12): whether a slot had green in the step that ended with each.
        """
        vehicles, standing = values[..., VEHICLES], values[..., QUEUE]
        queue = standing[:, 0]
        entered = [np.maximum(vehicles[:, 0] - queue, 0.0)]
        for step in range(1, self._history):
            first = (step - 1) * self.substeps
            arrivals = self._arriving(entered, first, first + self.substeps)
            left = self._leaving(queue, arrivals, green[step - 1], green[step])
            change = vehicles[:, step] - vehicles[:, step - 1]
            entered.append(np.maximum(change + left, 0.0))
            under_way = self._under_way(entered, step * self.substeps)
            queue = np.maximum(standing[:, step], vehicles[:, step] - under_way)
        now = (self._history - 1) * self.substeps
        arrivals = self._arriving(entered, now, now + self.horizon)
        running = np.maximum(vehicles[:, -1] - queue, 0.0)
        counted = np.minimum(running / np.maximum(under_way, 1e-9), 1.0)
        inflow = np.mean(entered[1:], axis=0) / self._interval
        return Traffic(queue, arrivals * counted, inflow)

    def later_arrivals(self, entering: FloatArray) -> FloatArray:
        """(T, M, N, 12) [vehicles] at the stop line of those who enter in each substep from now."""
        return np.asarray(np.einsum("kmns,ktns->tmns", entering, self._later_shares))

    @cached_property
    def capacity(self) -> FloatArray:
        """(T, 2, 2, N, 12) [vehicles] who can leave in each substep of a stage.

        By whether the slot had green in the stage before, and whether it has in this one.
        """
        return self._capacity(self.stage)

    @cached_property
    def step_capacity(self) -> FloatArray:
        """As ``capacity``, for the substeps of one decision step."""
        return self._capacity(self.substeps)

    def _capacity(self, count: int) -> FloatArray:
        found = np.zeros((count, 2, 2, self.network.n, N_SLOTS))
        flow = self._lanes / self._headway  # [vehicles/s]
        end = count * self.substep
        for k in range(count):
            first, last = k * self.substep, (k + 1) * self.substep
            found[k, 1, 1] = flow * self.substep
            found[k, 0, 1] = flow * _overlap(first, last, self._lost + START_LOSS, end)
            found[k, 1, 0] = flow * _overlap(first, last, 0.0, YELLOW_USE)
        return found

    def _leaving(
        self, queue: FloatArray, arrivals: FloatArray, before: BoolArray, green: BoolArray
    ) -> FloatArray:
        """(M, N, 12): who left in one decision step."""
        capacity = by_colour(self.step_capacity, before, green)
        left = np.zeros_like(queue)
        for k in range(self.substeps):
            there = queue + arrivals[k]
            out = np.minimum(capacity[k], there)
            queue, left = there - out, left + out
        return left

    def _arriving(self, entered: list[FloatArray], first: int, last: int) -> FloatArray:
        """(T, M, N, 12): at the stop line in the substeps since the oldest observation."""
        shares = self._shares[: len(entered), first:last]
        return np.asarray(np.einsum("kmns,ktns->tmns", np.array(entered), shares))

    def _under_way(self, entered: list[FloatArray], until: int) -> FloatArray:
        """(M, N, 12): who has not yet reached the stop line."""
        left = 1.0 - self._shares[: len(entered), :until].sum(axis=1)
        return np.asarray(np.einsum("kmns,kns->mns", np.array(entered), left))

    def _arrival_shares(self) -> FloatArray:
        """(C, T, N, 12): the part of a group that reaches the stop line in each substep.

        The first group is spread evenly over the road at the oldest observation, each of the others
        enters evenly in one of the decision steps since.
        """
        count = (self._history - 1) * self.substeps + self.horizon
        found = np.zeros((self._history, count, *self._travel.shape))
        for k in range(count):
            first, last = k * self.substep, (k + 1) * self.substep
            found[0, k] = _overlap(0.0, self._travel, first, last) / self._travel
            for group in range(1, self._history):
                begin = (group - 1) * self._interval + self._travel
                among = _overlap(begin, begin + self._interval, first, last)
                found[group, k] = among / self._interval
        return found

    @cached_property
    def _later_shares(self) -> FloatArray:
        """(T, T, N, 12): the part of those who enter in a substep that arrives in another."""
        found = np.zeros((self.horizon, self.horizon, *self._travel.shape))
        for k in range(self.horizon):
            begin = k * self.substep + self._travel
            for t in range(k, self.horizon):
                first, last = t * self.substep, (t + 1) * self.substep
                found[k, t] = _overlap(begin, begin + self.substep, first, last) / self.substep
        return found


def by_colour(
    capacity: FloatArray, before: npt.NDArray[np.bool_], green: npt.NDArray[np.bool_]
) -> FloatArray:
    """(T, …, 12): of ``capacity`` (T, 2, 2, …, 12) that of slots by the green before and now."""
    ending = np.where(before, capacity[:, 1, 0], capacity[:, 0, 0])
    return np.where(green, np.where(before, capacity[:, 1, 1], capacity[:, 0, 1]), ending)


def _overlap(a: float | FloatArray, b: float | FloatArray, first: float, last: float) -> FloatArray:
    """How much of the time from a to b lies between ``first`` and ``last``."""
    return np.asarray(np.maximum(np.minimum(b, last) - np.maximum(a, first), 0.0))


def _travel_time(context: ControlContext) -> FloatArray:
    """(N, 12) [s] along the part of a slot's lanes that its sensors cover, in the mean."""
    network, lanes = context.network, context.network.record.lanes
    longest = math.inf if context.detector_length is None else context.detector_length

    def seconds(lane: str) -> float:
        ends = [part.distance + lanes[part.lane].length for part in network.reach.get(lane, ())]
        covered = min(longest, max([lanes[lane].length, *ends]))
        return covered / min(lanes[lane].speed, context.max_speed)

    times = [
        [np.mean([seconds(lane) for lane in slot]) if slot else 0.0 for slot in slots]
        for slots in network.slot_lanes
    ]
    return np.array(times) + APPROACH_LOSS


def _lanes(network: Network) -> FloatArray:
    """(N, 12): entrance lanes of each slot, a shared one in equal parts; at least a part."""
    _, flat, weight = network.lane_slots
    found = np.bincount(flat, weight, minlength=network.n * N_SLOTS)
    return np.asarray(found.reshape(network.n, N_SLOTS))
