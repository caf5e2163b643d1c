"""Rolling horizon: plan a minute ahead with a traffic model, run the first step, plan again."""

from collections import deque

import numpy as np

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.point_queues import PointQueues, Traffic, by_colour
from tsc_missing.controllers.scores import best_phases
from tsc_missing.network.model import BoolArray, FloatArray, IntArray
from tsc_missing.network.slots import APPROACHES, TURNS
from tsc_missing.sensing.observation import Observation

NAME = "rolling-horizon"
HISTORY = 5  # observations that it looks at, as many as the diffusion model fills
AHEAD = 4  # stages of a plan
STAGE = 15.0  # [s] that a stage lasts at least
MOST_PLANS = 700  # of an intersection: where it has many phases fewer stages are planned
LEFT_OVER = 45.0  # [s] that each vehicle still waiting when a plan ends is taken to wait on,
LEFT_OVER_MORE = 0.75  # [s] and for each vehicle before it on its slot
LITTLE = 1e-3  # [vehicles/s] of a slot, so that the shares of turns are defined without inflow


class PhaseCosts:
    """What each phase costs: the waiting of the best plan that begins with it.

    A plan is a phase for each of the coming stages; its cost is the time that vehicles wait
    at the intersection's stop lines, and what is left over at the end is taken to wait on. All
    plans are tried (as in PRODYN, Henry, Farges and Tuffal 1983, with exhaustive search in the
    place of dynamic programming) on the arrivals that ``PointQueues`` expects. A second time
    they are tried with the arrivals that the neighbours' best plans of the first time bring.

    Where several samples tell what may be, a plan costs the mean over them: what is the case
    does not show before the plan is run.
    """

    def __init__(self, context: ControlContext, history: int = HISTORY) -> None:
        """For decisions from ``history`` observations."""
        network = context.network
        self._network = network
        hold = max(int(context.min_steps.max()), round(STAGE / context.decision_interval), 1)
        phases = network.phase_mask.shape[1]
        self._ahead = AHEAD
        while self._ahead > 1 and phases**self._ahead > MOST_PLANS:
            self._ahead -= 1
        self._roads = PointQueues(context, history, self._ahead, hold)
        self._planned = network.slot_mask & ~network.free_slots & network.phases.any(axis=1)
        self._fed = (network.neighbours >= 0).any(axis=2)
        table = network.phases  # (N, P, 12)
        capacity = self._roads.capacity[:, :, :, :, None, None]
        self._capacity = by_colour(capacity, table[:, :, None], table[:, None])
        self._absent = np.where(network.phase_mask, 0.0, np.inf)

    def of(self, values: FloatArray, green: BoolArray) -> FloatArray:
        """(N, P) [vehicle-seconds], infinite without the phase; NaN in gives NaN.

        ``values`` (M, C, N, 12, F) [vehicles] are the last observations, without holes, in M
        samples; ``green`` (C, N, 12) is what had green in the step that ended with each.
        """
        traffic = self._roads.estimate(values, green)
        usual = traffic.inflow * self._roads.substep
        usual = np.broadcast_to(usual, (self._roads.horizon, *usual.shape))
        arrivals = traffic.arrivals + self._roads.later_arrivals(usual)
        plans = self._costs(traffic.queue, arrivals, green[-1])
        best = np.broadcast_to(plans.argmin(axis=1), traffic.queue.shape[:2])
        out = self._leaving(traffic.queue, arrivals, green[-1], best)
        entering = self._entering(out, traffic)
        arrivals = traffic.arrivals + self._roads.later_arrivals(entering)
        plans = self._costs(traffic.queue, arrivals, green[-1])
        return np.asarray(plans.reshape(*self._absent.shape, -1).min(axis=2))

    def _costs(self, queue: FloatArray, arrivals: FloatArray, green: BoolArray) -> FloatArray:
        """(N, P ** stages) [vehicle-seconds]: of all plans, those that begin alike together."""
        roads = self._roads
        samples, n, slots = queue.shape
        phases = self._absent.shape[1]
        arrivals = np.where(self._planned, arrivals, 0.0)
        standing = np.where(self._planned, queue, 0.0)[:, :, None, None, None]
        cost = np.zeros((samples, n, 1, 1, 1))
        capacity = by_colour(
            roads.capacity[:, :, :, :, None], green[:, None], self._network.phases
        )[:, :, None]  # (T, N, 1, P, 12)
        for stage in range(self._ahead):
            for k in range(roads.stage):
                coming = arrivals[stage * roads.stage + k][:, :, None, None, None]
                standing = np.maximum(standing + coming - capacity[k][:, None], 0.0)
                cost = cost + standing.sum(axis=-1) * roads.substep
            cost = cost + self._absent[:, None, None]
            standing = standing.reshape(samples, n, -1, phases, 1, slots)
            cost = cost.reshape(samples, n, -1, phases, 1)
            capacity = self._capacity
        left = (LEFT_OVER * standing + LEFT_OVER_MORE * standing**2).sum(axis=-1)
        return np.asarray((cost + left).reshape(samples, n, -1).mean(axis=0))

    def _leaving(
        self, queue: FloatArray, arrivals: FloatArray, green: BoolArray, plans: IntArray
    ) -> FloatArray:
        """(T, M, N, 12) [vehicles] who leave in each substep of ``plans`` (M, N)."""
        phases = self._absent.shape[1]
        before = np.broadcast_to(green, queue.shape)
        out: list[FloatArray] = []
        for stage in range(self._ahead):
            phase = plans // phases ** (self._ahead - 1 - stage) % phases
            now = self._network.phases[np.arange(self._network.n), phase] | self._network.free_slots
            capacity = by_colour(self._roads.capacity[:, :, :, None], before, now)
            for k in range(self._roads.stage):
                there = queue + arrivals[len(out)]
                out.append(np.minimum(capacity[k], there))
                queue = there - out[-1]
            before = now
        return np.array(out)

    def _entering(self, out: FloatArray, traffic: Traffic) -> FloatArray:
        """(T, M, N, 12) [vehicles] who enter each slot's lanes in each substep.

        Who leaves upstream turns as the inflow of the last steps did; roads that no signal feeds
        have the inflow that they had.
        """
        upstream = self._network.neighbours
        flat = out.reshape(*out.shape[:2], -1)
        road = np.where(upstream >= 0, flat[..., upstream], 0.0).sum(axis=-1)
        inflow = traffic.inflow + LITTLE * self._network.slot_mask
        by_road = inflow.reshape(*inflow.shape[:2], len(APPROACHES), len(TURNS))
        turns = by_road / np.maximum(by_road.sum(axis=-1, keepdims=True), LITTLE)
        usual = traffic.inflow * self._roads.substep
        return np.where(self._fed, road * turns.reshape(inflow.shape), usual)


class RollingHorizon(Controller):
    """The phase that begins the plan with the least waiting (``PhaseCosts``).

    A rolling horizon as in OPAC (Gartner 1983, Transportation Research Record 906) and PRODYN.
    Needs complete values; ``decide`` raises ``ValueError`` on a hole.
    """

    def reset(self, context: ControlContext) -> None:
        """Take the network, and forget what was before."""
        self._costs = PhaseCosts(context)
        self._seen: deque[Observation] = deque(maxlen=HISTORY)

    def decide(self, observation: Observation) -> IntArray:
        """(N,): the first phase of the best plan; ties go to the lowest phase."""
        self._seen.append(observation)
        seen = [self._seen[0]] * (HISTORY - len(self._seen)) + [*self._seen]
        values = np.stack([one.values for one in seen])
        green = np.stack([one.red_steps == 0 for one in seen])
        return best_phases(-self._costs.of(values[None], green), NAME)
