"""What an imputer is, and how a controller is composed with one."""

from abc import ABC, abstractmethod

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.network.model import FloatArray, IntArray
from tsc_missing.sensing.observation import Observation


class Imputer(ABC):
    """Fills the holes of observations, one step after the other."""

    @abstractmethod
    def reset(self, context: ControlContext) -> None:
        """Forget everything and get ready for a run on the context's network."""

    @abstractmethod
    def fill(self, observation: Observation) -> Observation:
        """The observation with finite values everywhere; what was reported stays as it was."""


class Imputed(Controller):
    """A controller that sees every observation through an imputer."""

    def __init__(self, imputer: Imputer, controller: Controller) -> None:
        """Compose the two."""
        self.imputer = imputer
        self.controller = controller
        self._filled: FloatArray | None = None

    def reset(self, context: ControlContext) -> None:
        """Reset both."""
        self._filled = None
        self.imputer.reset(context)
        self.controller.reset(context)

    def decide(self, observation: Observation) -> IntArray:
        """The controller's decision on the filled observation."""
        filled = self.imputer.fill(observation)
        self._filled = filled.values
        return self.controller.decide(filled)

    def estimates(self) -> FloatArray | None:
        """(N, 12, F): the filled values of the last step."""
        return self._filled
