"""Fixed-time control: Webster's plan from turning counts, and plain cycles."""

import math
from abc import abstractmethod

import numpy as np

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.network.model import FloatArray, IntArray, Network
from tsc_missing.sensing.observation import Observation

SATURATION_FLOW = 1469.0  # [vehicles/h/lane], steady flow of the recorded scenarios' car
CYCLE_MIN = 60.0  # [s]
CYCLE_MAX = 180.0  # [s]
PRACTICAL_SATURATION = 0.9  # flow over capacity that a plan is designed for
NO_FLOW = 1e-6  # flow ratio that counts as none


class Cycle(Controller):
    """Repeats a plan of whole decision steps at each intersection, the phases in table order.

    A phase takes at least the context's ``min_steps``: one that the minimum green held would take
    the time of the next, in every cycle.
    The place in the cycle follows from the number of the step alone: phase 0 begins at step 0,
    and intersections with equal cycles stay in step whatever else ran in between.
    """

    needs_values = False

    @abstractmethod
    def plan(self, context: ControlContext) -> IntArray:
        """(N, P): the decision steps of each phase, 0 where there is no such phase."""

    def reset(self, context: ControlContext) -> None:
        """Lay out the plan as a table of phases."""
        plan = self.plan(context)
        self._length = plan.sum(axis=1)
        self._table: IntArray = np.zeros((len(plan), self._length.max()), dtype=np.int64)
        for row, steps in zip(self._table, plan, strict=True):
            row[: steps.sum()] = np.repeat(np.arange(len(steps)), steps)

    def decide(self, observation: Observation) -> IntArray:
        """(N,): the plan's phases at the observation's step; nothing else of it is used."""
        phases: IntArray = self._table[np.arange(len(self._table)), observation.step % self._length]
        return phases


class PlainCycle(Cycle):
    """Every phase for the same time, yellow included."""

    def __init__(self, seconds: float) -> None:
        """``seconds`` [s] a phase, rounded to whole decision steps, at least ``min_steps``."""
        self._seconds = seconds

    def plan(self, context: ControlContext) -> IntArray:
        """(N, P): the same number of steps for every phase of an intersection."""
        steps = np.maximum(context.min_steps, round(self._seconds / context.decision_interval))
        return np.where(context.network.phase_mask, steps[:, None], 0).astype(np.int64)


class FixedTime(Cycle):
    """Webster's plan (1958, Traffic signal settings, Road Research Technical Paper 39).

    With the critical flow ratio y of each phase, Y their sum and L the time lost in a cycle,

        C = (1.5 L + 5) / (1 - Y), kept within 60 s and 180 s

    and greens in proportion to y, so that all phases have the same degree of saturation
    x = y C / green. Phases last whole decision steps, at least ``min_steps``, so the split is the
    one with the smallest largest x; where that is above 0.9, which rounding alone can bring about,
    the cycle is lengthened, by steps, to the first that stays below, or to the best there is.
    """

    def plan(self, context: ControlContext) -> IntArray:
        """(N, P): the decision steps of each phase."""
        ratios = critical_ratios(context.network, context.turning_flows)
        plan = np.zeros(ratios.shape, dtype=np.int64)
        times = context.lost_time, context.decision_interval
        for n, mask in enumerate(context.network.phase_mask):
            plan[n, mask] = webster_plan(ratios[n, mask], *times, int(context.min_steps[n]))
        return plan


def slot_flow_ratios(network: Network, flows: FloatArray) -> FloatArray:
    """(N, 12): flow over saturation flow on a slot's busiest lane, given ``flows`` [vehicles/h].

    A movement's flow spreads evenly over its lanes, without those for buses only where it has
    others; a lane carries all movements that use it.
    """
    lanes, flat, _ = network.lane_slots
    closed = [bool(network.record.lanes[lane].no_cars) for lane in network.entrance_lanes]
    part = np.where(np.array(closed)[lanes], 1e-9, 1.0)  # hardly anything, where there are others
    parts = np.bincount(flat, weights=part, minlength=flows.size)
    load = np.bincount(lanes, weights=flows.reshape(-1)[flat] / parts[flat] * part)
    ratios = np.zeros(flows.size)
    np.maximum.at(ratios, flat, load[lanes] / SATURATION_FLOW)
    return ratios.reshape(flows.shape)


def critical_ratios(network: Network, flows: FloatArray) -> FloatArray:
    """(N, P): the largest flow ratio of the slots that a phase serves.

    A slot that several phases serve asks each for an equal part of its green.
    """
    phases = network.phases
    asked = slot_flow_ratios(network, flows) / np.maximum(phases.sum(axis=1), 1)
    critical: FloatArray = np.where(phases, asked[:, None, :], 0.0).max(axis=2)
    return critical


def webster_plan(ratios: FloatArray, lost_time: float, interval: float, least: int = 1) -> IntArray:
    """(P,): steps of ``interval`` [s] for phases with these critical ratios at one intersection.

    ``lost_time`` [s] is lost at every change of phase, so none where there is one phase; each takes
    at ``least`` so many steps.
    """
    lost = lost_time if len(ratios) > 1 else 0.0
    cycle = webster_cycle(float(ratios.sum()), lost * len(ratios))
    shortest = max(len(ratios) * least, math.floor(cycle / interval + 0.5))
    longest = max(shortest, math.floor(CYCLE_MAX / interval))
    best, lowest = np.full(len(ratios), least), math.inf
    for total in range(shortest, longest + 1):
        steps = split_steps(ratios, lost, interval, total, least)
        saturation = float((ratios * total * interval / (steps * interval - lost)).max())
        if saturation < lowest:
            best, lowest = steps, saturation
        if saturation <= PRACTICAL_SATURATION:
            break
    return best


def webster_cycle(total_ratio: float, lost: float) -> float:
    """Webster's cycle [s] for the sum of critical ratios and the time lost in a cycle [s]."""
    if total_ratio >= 1.0:
        return CYCLE_MAX
    return min(max((1.5 * lost + 5.0) / (1.0 - total_ratio), CYCLE_MIN), CYCLE_MAX)


def split_steps(
    ratios: FloatArray, lost: float, interval: float, total: int, least: int = 1
) -> IntArray:
    """(P,): ``total`` steps so that the largest ratio of flow to green is as small as it can be.

    The ``least`` number of steps each, then one by one to the phase that is worst off; ties go to
    the lowest phase, and steps that no flow asks for are spread evenly.
    """
    asked = np.maximum(ratios, NO_FLOW)
    steps = np.full(len(ratios), least)
    for _ in range(total - steps.sum()):
        worst = asked / (steps * interval - lost)
        steps[np.argmax(worst.round(12))] += 1
    return steps
