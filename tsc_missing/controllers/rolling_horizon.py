"""Rolling horizon: plan a minute ahead with a traffic model, run the first step, plan again."""

import numpy as np

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.point_queues import PointQueues, by_colour
from tsc_missing.controllers.recent import reported
from tsc_missing.controllers.scores import best_phases
from tsc_missing.network.model import BoolArray, FloatArray, IntArray
from tsc_missing.sensing.observation import Observation

NAME = "rolling-horizon"
AHEAD = 4  # stages of a plan
STAGE = 15.0  # [s] that a stage lasts about, or as long as most intersections' phases must
MOST_PLANS = 700  # of an intersection; where any has many phases all plan fewer stages
LEFT_OVER = 45.0  # [s] that each vehicle still waiting when a plan ends is taken to wait on,
LEFT_OVER_MORE = 0.75  # [s] and for each vehicle before it on its slot


class HorizonPlans:
    """What each phase costs: the waiting of the best plan that begins with it.

    A plan is a phase for each of the coming stages; its cost is the time that vehicles wait
    at the intersection's stop lines, and what is left over at the end is taken to wait on. All
    plans are tried (as in PRODYN, Henry, Farges and Tuffal 1983, with exhaustive search in the
    place of dynamic programming) on the arrivals that ``PointQueues`` expects. A second time
    they are tried with the arrivals that the neighbours' best plans of the first time bring.
    """

    def __init__(self, context: ControlContext) -> None:
        """For a run on the context's network."""
        network = context.network
        self._network = network
        usual = int(np.quantile(context.min_steps, 0.5, method="lower"))
        hold = max(usual, round(STAGE / context.decision_interval), 1)
        phases = network.phase_mask.shape[1]
        self._ahead = AHEAD
        while self._ahead > 1 and phases**self._ahead > MOST_PLANS:
            self._ahead -= 1
        self._roads = PointQueues(context, self._ahead, hold)
        self._planned = network.slot_mask & ~network.free_slots & network.phases.any(axis=1)
        table = network.phases  # (N, P, 12)
        if self._ahead > 1:
            capacity = self._roads.capacity[:, :, :, :, None, None]
            self._capacity = by_colour(capacity, table[:, :, None], table[:, None])
        self._absent = np.where(network.phase_mask, 0.0, np.inf)

    def costs(self, observation: Observation, guess: FloatArray | None = None) -> FloatArray:
        """(N, P) [vehicle-seconds] after the next observation of a run, infinite without the phase.

        ``guess`` (N, 12, F) [vehicles] is of what did not report (``PointQueues.take``).
        """
        roads, green = self._roads, observation.red_steps == 0
        traffic = roads.take(observation, guess)
        arrivals = traffic.arrivals + roads.later_arrivals(roads.usual())
        plans = self._costs(traffic.queue, arrivals, green)
        out = self._leaving(traffic.queue, arrivals, green, plans.argmin(axis=1))
        arrivals = traffic.arrivals + roads.later_arrivals(roads.following(out))
        plans = self._costs(traffic.queue, arrivals, green)
        return np.asarray(plans.reshape(*self._absent.shape, -1).min(axis=2))

    def believed(self, observation: Observation) -> FloatArray:
        """(N, 12, F) [vehicles]: what was observed, and elsewhere what the plans are made for."""
        seen = reported(observation)[:, :, None]
        return np.where(seen, observation.values, self._roads.values)

    def _costs(self, queue: FloatArray, arrivals: FloatArray, green: BoolArray) -> FloatArray:
        """(N, P ** stages) [vehicle-seconds]: of all plans, those that begin alike together."""
        roads = self._roads
        n, phases = self._absent.shape
        arrivals = np.where(self._planned, arrivals, 0.0)
        standing = np.where(self._planned, queue, 0.0)[:, None, None, None]
        cost = np.zeros((n, 1, 1, 1))
        capacity = by_colour(
            roads.capacity[:, :, :, :, None], green[:, None], self._network.phases
        )[:, :, None]  # (T, N, 1, P, 12)
        for stage in range(self._ahead):
            for k in range(roads.stage):
                coming = arrivals[stage * roads.stage + k][:, None, None, None]
                standing = np.maximum(standing + coming - capacity[k][:, None], 0.0)
                cost = cost + standing.sum(axis=-1) * roads.substep
            cost = cost + self._absent[:, None, None]
            standing = standing.reshape(n, -1, phases, 1, queue.shape[1])
            cost = cost.reshape(n, -1, phases, 1)
            if stage + 1 < self._ahead:
                capacity = self._capacity
        left = (LEFT_OVER * standing + LEFT_OVER_MORE * standing**2).sum(axis=-1)
        return np.asarray((cost + left).reshape(n, -1))

    def _leaving(
        self, queue: FloatArray, arrivals: FloatArray, green: BoolArray, plans: IntArray
    ) -> FloatArray:
        """(T, N, 12) [vehicles] who leave in each substep of ``plans`` (N,)."""
        n, phases = self._absent.shape
        out: list[FloatArray] = []
        for stage in range(self._ahead):
            phase = plans // phases ** (self._ahead - 1 - stage) % phases
            now = self._network.phases[np.arange(n), phase] | self._network.free_slots
            capacity = by_colour(self._roads.capacity, green, now)
            for k in range(self._roads.stage):
                there = queue + arrivals[len(out)]
                out.append(np.minimum(capacity[k], there))
                queue = there - out[-1]
            green = now
        return np.array(out)


class RollingHorizon(Controller):
    """The phase that begins the plan with the least waiting (``HorizonPlans``).

    A rolling horizon as in OPAC (Gartner 1983, Transportation Research Record 906) and PRODYN.
    It learns nothing, and needs no sensor anywhere: the traffic model goes on where none reports,
    from turning counts and from what the sensors around saw.
    """

    needs_values = False

    def reset(self, context: ControlContext) -> None:
        """Take the network, and forget what was before."""
        self._plans = HorizonPlans(context)
        self._believed: FloatArray | None = None

    def decide(self, observation: Observation) -> IntArray:
        """(N,): the first phase of the best plan; ties go to the lowest phase."""
        costs = self._plans.costs(observation)
        self._believed = self._plans.believed(observation)
        return best_phases(-costs, NAME)

    def estimates(self) -> FloatArray | None:
        """(N, 12, F) [vehicles]: what the last decision was based on."""
        return self._believed
