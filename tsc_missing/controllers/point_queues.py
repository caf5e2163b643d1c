"""A traffic model of the roads into signals: who waits at the stop line, and who arrives when."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tsc_missing.controllers.base import ControlContext
from tsc_missing.controllers.recent import reported
from tsc_missing.controllers.spillback import storage
from tsc_missing.controllers.uncounted import UncountedTurns
from tsc_missing.controllers.upstream import Roads
from tsc_missing.network.model import BoolArray, FloatArray
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.sensing.observation import QUEUE, VEHICLES, Observation

SUBSTEP = 5.0  # [s] about which the model steps: the yellow of the paper's signals
LEAST_HEADWAY = 2.0  # [s] between vehicles that leave a lane: 1800 vehicles an hour
START_LOSS = 1.5  # [s] of a green until vehicles leave at the saturation headway
YELLOW_USE = 1.0  # [s] of a yellow in which vehicles still leave
APPROACH_LOSS = 4.0  # [s] that a vehicle takes longer to the stop line than at the speed limit
MEMORY = 0.05  # weight of a decision step's inflow in the usual inflow
GAIN = 0.02  # part of the difference to a guess by which a prediction is corrected in a step
UNCOUNTED_GAIN = 0.2  # the same of predictions without turning counts
TINY = 1e-9  # [vehicles] that keep shares of nobody defined
LITTLE = 1e-4  # [vehicles/s] of a slot, so that turns are defined without inflow


@dataclass(frozen=True)
class Traffic:
    """What the model believes of the roads now.

    Vehicles that are yet to come onto the road are in neither of the first two.
    """

    queue: FloatArray  # (N, 12) [vehicles] that would be at the stop line now if nobody queued
    arrivals: FloatArray  # (T, N, 12) [vehicles] now on the road who reach it in each substep
    inflow: FloatArray  # (N, 12) [vehicles/s] that usually enter the road


class PointQueues:
    """Roads as travel times that end in a queue without length, a slot at a time.

    The point queue of Vickrey (American Economic Review 59, 1969): a vehicle that enters a slot's
    lanes reaches the stop line after the time that they take at the speed limit and
    ``APPROACH_LOSS``, and leaves it in the order of arrival: under green at the saturation headway
    of each lane, but not in the yellow before and ``START_LOSS`` after it; under a yellow that ends
    a green for ``YELLOW_USE``.

    Who enters in a decision step is predicted: who leaves upstream, by the turns that are usual; on
    roads that no signal feeds, the usual inflow. Where a sensor reports, its count corrects that,

        inflow = change of the count + outflow,    queue = max(observed queue, count - under way),

    where the outflow is the model's own, and only the rest of the count is under way: what the
    model gets wrong does not add up. Where none does the prediction stands, drawn by ``GAIN``
    towards a guess if there is one, and kept to what the road has room for. When in the step they
    entered is told by the outflow upstream, and after a silence by what was predicted in it.
    The usual inflow begins with the turning counts, and follows what is observed or guessed.
    Without turning counts a guess weighs more (``UNCOUNTED_GAIN``), and the usual inflow of slots
    without a sensor is what the roads around tell (``UncountedTurns``).
    """

    def __init__(self, context: ControlContext, ahead: int, hold: int) -> None:
        """Empty roads; to look ``ahead`` stages of ``hold`` decision steps on.

        A stage is a time in which no signal changes.
        """
        self.network = context.network
        self._interval = context.decision_interval
        self._lost = context.lost_time
        self._gain = GAIN if context.counted else UNCOUNTED_GAIN
        self.substeps = max(1, round(self._interval / SUBSTEP))  # of a decision step
        self.substep = self._interval / self.substeps  # [s]
        self.stage = hold * self.substeps  # substeps of a stage
        self.horizon = ahead * self.stage  # substeps
        self._travel = _travel_time(context)
        self._flow = _saturation_flow(context)
        self._room = storage(self.network, context.spacing)
        self._roads = Roads.of(context)
        self._turns = UncountedTurns.of(context, self._roads)
        self._lag = self._lags()
        shape = self.network.slot_mask.shape
        self._calendar = np.zeros((self.horizon + len(self._lag) + self.substeps, *shape))
        self._untold = np.zeros_like(self._calendar)  # of the calendar: who entered in a silence
        self._silent = np.zeros(shape)  # [vehicles] who entered in a silence and are still there
        self._queue = np.zeros(shape)
        self._vehicles = np.zeros(shape)
        self._inflow = context.turning_flows / 3600.0
        self._least = LITTLE * self._interval * (context.sensors & self.network.slot_mask)
        self._green = np.zeros(shape, dtype=bool)
        self._known = np.zeros(shape, dtype=bool)
        self._began = False

    def take(self, observation: Observation, guess: FloatArray | None = None) -> Traffic:
        """Take in the next observation of a run; ``guess`` (N, 12, F) [vehicles] of its holes."""
        green, known = observation.red_steps == 0, reported(observation)
        left = np.zeros((self.substeps, *known.shape))
        if self._began:
            left = self._leaving(green)
        out, expected = left.sum(axis=0), self._expected(left)
        vehicles = self._predicted(self._vehicles - out + expected, guess)
        vehicles = np.where(known, observation.values[:, :, VEHICLES], vehicles)
        inflow = self._entered(vehicles, out, expected, known)
        self._enter(inflow * self._profile(left), known)
        if self._began:
            told = known & self._known  # one report after a silence tells of all of it
            if guess is not None:
                told |= ~known
            self._learn(inflow / self._interval, told, guess is not None)
        self._settle(vehicles, np.where(known, observation.values[:, :, QUEUE], 0.0))
        self._green, self._known, self._began = green, known, True
        return Traffic(self._queue, self._calendar[: self.horizon].copy(), self._inflow)

    def _learn(self, inflow: FloatArray, told: BoolArray, guessed: bool) -> None:
        """Let the usual inflow follow that of a step (N, 12) [vehicles/s] where it was told.

        Without turning counts, also by what is let go upstream, and by the roads around.
        """
        if self._turns is not None:
            told = told | (self._turns.slots & self._roads.fed)
        self._inflow = self._inflow + np.where(told, MEMORY * (inflow - self._inflow), 0.0)
        if self._turns is not None:
            self._inflow = self._turns.fitted(self._inflow, guessed)

    @property
    def values(self) -> FloatArray:
        """(N, 12, F) [vehicles]: on the road and in the queue, as is believed now."""
        return np.stack((self._vehicles, self._queue), axis=2)

    @property
    def turns(self) -> FloatArray:
        """(N, 12): which part of a road's inflow enters each of its slots."""
        return self._roads.shares(self._inflow + LITTLE * self.network.slot_mask)

    def usual(self) -> FloatArray:
        """(T, N, 12) [vehicles] who enter in each substep from now if the inflow is as usual."""
        entering = self._inflow * self.substep
        return np.broadcast_to(entering, (self.horizon, *entering.shape))

    def following(self, out: FloatArray) -> FloatArray:
        """(T, N, 12) [vehicles] who enter in each substep if those ``out`` (T, N, 12) leave."""
        return np.where(self._roads.fed, self._roads.entering(out) * self.turns, self.usual())

    def later_arrivals(self, entering: FloatArray) -> FloatArray:
        """(T, N, 12) [vehicles] at the stop line of those who enter in each substep from now."""
        found = np.zeros_like(entering)
        for k, lag in enumerate(self._lag[: len(found)]):
            found[k:] += entering[: len(found) - k] * lag
        return found

    def _expected(self, left: FloatArray) -> FloatArray:
        """(N, 12) [vehicles] who enter in a decision step."""
        if not self._began:
            return np.zeros_like(self._inflow)
        fed = self._roads.entering(left).sum(axis=0) * self.turns
        usual = self._inflow * self._interval
        return np.asarray(np.maximum(np.where(self._roads.fed, fed, usual), self._least))

    def _predicted(self, vehicles: FloatArray, guess: FloatArray | None) -> FloatArray:
        """(N, 12): ``vehicles`` (N, 12) drawn towards a guess, and kept to what there is room for.

        A guess that is no number counts for nothing: what is wrong once would stay.
        """
        vehicles = np.maximum(vehicles, 0.0)
        if guess is not None:
            drawn = self._gain * (guess[:, :, VEHICLES] - vehicles)
            vehicles = vehicles + np.where(np.isfinite(drawn), drawn, 0.0)
        return np.minimum(vehicles, self._room)

    def _entered(
        self, vehicles: FloatArray, out: FloatArray, expected: FloatArray, known: BoolArray
    ) -> FloatArray:
        """(N, 12) [vehicles] who entered in a decision step that left ``vehicles`` (N, 12) there.

        A report after a silence tells of all who entered in it and have not left: those on their
        way are made more or fewer in the parts in which they were ``expected``, step by step.
        """
        inflow = vehicles - self._vehicles + out
        since, silent = self._silent + inflow, np.maximum(self._silent, 0.0)
        part = np.maximum(since, 0.0) / (silent + expected + TINY)
        self._calendar += np.where(known, part - 1.0, 0.0) * self._untold
        self._untold = np.where(known, 0.0, self._untold)
        self._silent = np.where(known, 0.0, np.minimum(since, vehicles))
        return np.maximum(np.where(known, np.maximum(since, 0.0) - part * silent, inflow), 0.0)

    def _profile(self, left: FloatArray) -> FloatArray:
        """(T, N, 12): in which substep of a decision step those entered who entered.

        When the slots upstream let vehicles go; evenly where no signal feeds the road.
        """
        fed = self._roads.entering(left) + TINY
        return np.where(self._roads.fed, fed / fed.sum(axis=0), 1 / self.substeps)

    def _enter(self, entering: FloatArray, known: BoolArray) -> None:
        """Put who entered in a decision step (T, N, 12) into the calendar, and go on to now."""
        for k, group in enumerate(entering):
            arriving = group * self._lag
            self._calendar[k : k + len(self._lag)] += arriving
            self._untold[k : k + len(self._lag)] += np.where(known, 0.0, arriving)
        for calendar in (self._calendar, self._untold):
            calendar[: -self.substeps] = calendar[self.substeps :]
            calendar[-self.substeps :] = 0.0

    def _settle(self, vehicles: FloatArray, standing: FloatArray) -> None:
        """Make the queues and those under way come to ``vehicles``, at least ``standing`` queue."""
        under_way = self._calendar.sum(axis=0)
        self._queue = np.maximum(standing, vehicles - under_way)
        running = np.maximum(vehicles - self._queue, 0.0)
        kept = np.minimum(running / np.maximum(under_way, TINY), 1.0)
        self._calendar *= kept
        self._untold *= kept
        self._vehicles = vehicles

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
        flow = self._flow
        end = count * self.substep
        for k in range(count):
            first, last = k * self.substep, (k + 1) * self.substep
            found[k, 1, 1] = flow * self.substep
            found[k, 0, 1] = flow * _overlap(first, last, self._lost + START_LOSS, end)
            found[k, 1, 0] = flow * _overlap(first, last, 0.0, YELLOW_USE)
        return found

    def _leaving(self, green: BoolArray) -> FloatArray:
        """(T, N, 12): who left in each substep of the decision step that had ``green``."""
        capacity = by_colour(self.step_capacity, self._green, green)
        left, queue = np.zeros_like(capacity), self._queue
        for k in range(self.substeps):
            there = queue + self._calendar[k]
            left[k] = np.minimum(capacity[k], there)
            queue = there - left[k]
        return left

    def _lags(self) -> FloatArray:
        """(D, N, 12): the part of those who enter in a substep that arrives k substeps later."""
        count = math.ceil(self._travel.max() / self.substep) + 1
        found = np.zeros((count, *self._travel.shape))
        for k in range(count):
            first = k * self.substep
            among = _overlap(self._travel, self._travel + self.substep, first, first + self.substep)
            found[k] = among / self.substep
        return found


def by_colour(capacity: FloatArray, before: BoolArray, green: BoolArray) -> FloatArray:
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


def _saturation_flow(context: ControlContext) -> FloatArray:
    """(N, 12) [vehicles/s] that leave a slot's queue; of shared lanes in equal parts.

    A vehicle follows the one before in ``tau`` and the time in which it drives its own space, but
    not sooner than in ``LEAST_HEADWAY``: out of a queue nobody drives at the speed limit at once.
    """
    network, lanes = context.network, context.network.record.lanes
    speeds = [min(lanes[name].speed, context.max_speed) for name in network.entrance_lanes]
    flow = 1.0 / np.maximum(context.tau + context.spacing / np.array(speeds), LEAST_HEADWAY)
    lane, flat, weight = network.lane_slots
    found = np.bincount(flat, weight * flow[lane], minlength=network.n * N_SLOTS)
    return np.asarray(found.reshape(network.n, N_SLOTS))
