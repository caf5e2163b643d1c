"""Max-pressure: green where vehicles wait and there is room behind the intersection."""

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.scores import best_phases, downstream_mean, phase_scores
from tsc_missing.network.model import IntArray
from tsc_missing.sensing.observation import VEHICLES, Observation


class MaxPressure(Controller):
    """The phase with the largest pressure, after Varaiya (2013, Transp. Res. C 36, 177-195).

    The pressure of a phase is the sum over its movements of the vehicles on the entrance lanes
    minus the mean of the vehicles on the lanes of the exit road. Needs complete values;
    ``decide`` raises ``ValueError`` on a hole.
    """

    def reset(self, context: ControlContext) -> None:
        """Take the network; there is nothing else to remember."""
        self._network = context.network

    def decide(self, observation: Observation) -> IntArray:
        """(N,): the phase with the largest pressure; ties go to the lowest phase."""
        vehicles = observation.values[:, :, VEHICLES]
        pressure = vehicles - downstream_mean(self._network, vehicles, observation.exits)
        return best_phases(phase_scores(self._network, pressure), "max-pressure")
