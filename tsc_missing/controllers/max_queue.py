"""Max-queue: green for the longest queue."""

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.scores import best_phases, phase_scores
from tsc_missing.network.model import IntArray
from tsc_missing.sensing.observation import QUEUE, Observation


class MaxQueue(Controller):
    """The phase with the most queueing vehicles on the entrance lanes of its slots.

    Needs complete queues; ``decide`` raises ``ValueError`` on a hole.
    """

    def reset(self, context: ControlContext) -> None:
        """Take the network; there is nothing else to remember."""
        self._network = context.network

    def decide(self, observation: Observation) -> IntArray:
        """(N,): the phase with the largest sum of queues; ties go to the lowest phase."""
        scores = phase_scores(self._network, observation.values[:, :, QUEUE])
        return best_phases(scores, "max-queue")
