"""Fixed-time control: Webster's plan from turning counts, and plain cycles."""

from abc import abstractmethod

import numpy as np

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.network.model import BoolArray, FloatArray, IntArray, Network
from tsc_missing.sensing.observation import Observation

SATURATION_FLOW = 1469.0  # [vehicles/h/lane], steady flow of the recorded scenarios' car
CYCLE_MIN = 60.0  # [s]
CYCLE_MAX = 180.0  # [s]


class Cycle(Controller):
    """Repeats a plan of whole decision steps at each intersection, the phases in table order.

    The place in the cycle follows from the number of the step alone: phase 0 begins at step 0,
    and intersections with equal cycles stay in step whatever else ran in between.
    """

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
        """``seconds`` [s] a phase, rounded to whole decision steps, at least one."""
        self._seconds = seconds

    def plan(self, context: ControlContext) -> IntArray:
        """(N, P): the same number of steps for every phase."""
        steps = max(1, round(self._seconds / context.decision_interval))
        return np.where(context.network.phase_mask, steps, 0).astype(np.int64)


class FixedTime(Cycle):
    """Webster's plan (1958, Traffic signal settings, Road Research Technical Paper 39).

    With the critical flow ratio y of each phase, Y their sum and L the time lost in a cycle,

        C = (1.5 L + 5) / (1 - Y), kept within 60 s and 180 s
        phase duration = lost time + (C - L) y / Y

    and durations are rounded to whole decision steps, at least one a phase. Without flow all
    phases are equal; if Y is 1 or more the cycle is the longest.
    """

    def plan(self, context: ControlContext) -> IntArray:
        """(N, P): Webster's phase durations in decision steps."""
        network, interval = context.network, context.decision_interval
        present = network.phase_mask
        count = present.sum(axis=1)
        lost = np.where(count > 1, count * context.lost_time, 0.0)
        ratios = critical_ratios(network, context.turning_flows)
        cycle = np.maximum(webster_cycle(ratios.sum(axis=1), lost), count * interval)
        shares = _shares(ratios, present)
        durations = present * (lost / count)[:, None] + (cycle - lost)[:, None] * shares
        steps = np.maximum(np.floor(cycle / interval + 0.5).astype(np.int64), count)
        return np.array(
            [
                whole_steps(row / interval, mask, total)
                for row, mask, total in zip(durations, present, steps, strict=True)
            ]
        )


def slot_flow_ratios(network: Network, flows: FloatArray) -> FloatArray:
    """(N, 12): flow over saturation flow on a slot's busiest lane, given ``flows`` [vehicles/h].

    A movement's flow spreads evenly over its lanes; a lane carries all movements that use it.
    """
    lanes, flat, _ = network.lane_slots
    per_lane = flows.reshape(-1) / np.maximum(network.slot_lane_count.reshape(-1), 1)
    load = np.bincount(lanes, weights=per_lane[flat])
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


def webster_cycle(total_ratio: FloatArray, lost: FloatArray) -> FloatArray:
    """(N,): Webster's cycle [s] for the sum of critical ratios and the time lost in a cycle [s]."""
    spare = np.maximum(1.0 - total_ratio, 1e-9)
    return np.clip((1.5 * lost + 5.0) / spare, CYCLE_MIN, CYCLE_MAX)


def whole_steps(ideal: FloatArray, present: BoolArray, total: int) -> IntArray:
    """(P,): ``total`` steps for the phases present: one each, then by the largest shortfall.

    Where no phase wants less than one step this is the method of largest remainders; ties go to
    the lowest phase.
    """
    steps = present.astype(np.int64)
    for _ in range(total - steps.sum()):
        shortfall = np.where(present, ideal - steps, -np.inf)
        steps[np.argmax(shortfall.round(9))] += 1
    return steps


def _shares(ratios: FloatArray, present: BoolArray) -> FloatArray:
    """(N, P): rows that sum to 1, by ratio, or equal where there is no flow at all."""
    weights = np.where(ratios.sum(axis=1, keepdims=True) > 0, ratios, present)
    shares: FloatArray = weights / weights.sum(axis=1, keepdims=True)
    return shares
