"""Behaviour policies: who decides while data are collected."""

from collections.abc import Callable, Sequence

import numpy as np

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.registry import CONTROLLERS
from tsc_missing.network.model import IntArray
from tsc_missing.seeding import stream
from tsc_missing.sensing.observation import Observation

RULES = ("advanced-max-pressure", "fixed-time", "max-pressure", "max-queue")

POLICIES: dict[str, Callable[[], Controller]] = {name: CONTROLLERS[name].make for name in RULES}
"""Controllers for complete observations, by name; learned ones are added here."""


class Exploring(Controller):
    """A controller whose decision is a random phase with probability ``epsilon``.

    Drawn for each intersection and step; all phases that the intersection has are alike probable.
    """

    def __init__(self, controller: Controller, epsilon: float) -> None:
        """``epsilon`` in 0 … 1."""
        self._controller = controller
        self._epsilon = epsilon

    def reset(self, context: ControlContext) -> None:
        """Reset the controller and start the run's own stream of random numbers."""
        self._controller.reset(context)
        self._phase_mask = context.network.phase_mask
        self._random = stream(context.seed, "exploring")

    def decide(self, observation: Observation) -> IntArray:
        """(N,): the controller's phases, some replaced by random ones."""
        phases = self._controller.decide(observation)
        explore = self._random.random(len(phases)) < self._epsilon
        draws = self._random.random(self._phase_mask.shape)
        anything = np.where(self._phase_mask, draws, -1.0).argmax(axis=1)
        return np.where(explore, anything, phases).astype(np.int64)


class InTurn(Controller):
    """One controller up to a step, another from there on; both watch all the time."""

    def __init__(self, first: Controller, second: Controller, step: int) -> None:
        """``step`` is the first that the second controller decides."""
        self._controllers = (first, second)
        self._step = step

    def reset(self, context: ControlContext) -> None:
        """Reset both."""
        for controller in self._controllers:
            controller.reset(context)

    def decide(self, observation: Observation) -> IntArray:
        """(N,): the phases of the one whose turn it is."""
        answers = [controller.decide(observation) for controller in self._controllers]
        return answers[observation.step >= self._step]


def make_policy(names: Sequence[str], switch_at: int | None, epsilon: float) -> Controller:
    """The policy ``names[0]``, or two in turn, with exploration."""
    policy = POLICIES[names[0]]()
    if switch_at is not None:
        policy = InTurn(policy, POLICIES[names[1]](), switch_at)
    return Exploring(policy, epsilon)
