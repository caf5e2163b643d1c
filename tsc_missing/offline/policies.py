"""Behaviour policies: who decides while data are collected."""

from collections.abc import Sequence

import numpy as np

from tsc_missing.config import RunSettings
from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.catalogue import DIFFLIGHT, LEARNED, VALUE
from tsc_missing.controllers.expected_queue import ExpectedQueue
from tsc_missing.controllers.fixed_time import FixedTime
from tsc_missing.controllers.random_phases import RandomPhases, SkewedPhases
from tsc_missing.controllers.registry import make_controller, roomy
from tsc_missing.controllers.registry import make_policy as make_one
from tsc_missing.controllers.wrapper import Wrapper
from tsc_missing.errors import UserError
from tsc_missing.imputation.base import Imputed
from tsc_missing.imputation.registry import make_imputer
from tsc_missing.network.model import BoolArray, IntArray
from tsc_missing.own_code import is_own, named
from tsc_missing.seeding import stream
from tsc_missing.sensing.observation import Observation

RULES = ("advanced-max-pressure", "fixed-time", "max-pressure", "max-queue")
POLICIES = (*RULES, *LEARNED, VALUE, DIFFLIGHT)
"""Controllers by name; the learned ones have packaged weights."""

AT_RANDOM = (2, 3)  # places of the unaware policies that stay a while
STAY = 0.6  # probability that a signal that is switched at random stays as it is
SPREAD = 0.5  # of the logarithm of an error in the flows that an unaware policy believes


class Unaware(Controller):
    """Leaves some intersections to policies that see nothing of the traffic.

    A policy that sees the traffic tells it by what it does: a red that lasts says that nobody
    waits. Who learns from its log what is likely behind a hole learns that, and is deceived
    where the signals follow what he believes. At an unaware intersection there is nothing to
    learn from the signals but what they do to the traffic.

    Each of them has, at random, expected-queue with errors in its flows, the fixed-time plan, or
    phases at random that stay a while. These give much green where much comes, or to all alike,
    so that even there a long red tells that few come. A part of them neglects some phases instead,
    whatever comes: phases at random that stay a while and of which some are seldom.
    """

    def __init__(
        self, controller: Controller, unaware: BoolArray, seed: int, neglect: float = 0.0
    ) -> None:
        """``unaware`` (N,); ``seed`` of who has which policy, and of the random phases.

        ``neglect`` is the share of those that neglect some phases.
        """
        self._controller = controller
        self._unaware = unaware
        self._seed = seed
        self._neglect = neglect
        self._blind = (ExpectedQueue(SPREAD), FixedTime(), RandomPhases(), SkewedPhases())

    def reset(self, context: ControlContext) -> None:
        """Reset all."""
        for controller in (self._controller, *self._blind):
            controller.reset(context)
        self._random = stream(self._seed, "unaware-policies")
        last = len(self._blind) - 1
        some = self._random.integers(last, size=context.network.n)
        neglects = stream(self._seed, "neglect").random(context.network.n) < self._neglect
        self._which = np.where(neglects, last, some)

    def decide(self, observation: Observation) -> IntArray:
        """(N,): each intersection's own policy."""
        phases = self._controller.decide(observation)
        blind = [controller.decide(observation) for controller in self._blind]
        stay = (self._random.random(len(phases)) < STAY) & (observation.phase >= 0)
        for k in AT_RANDOM:
            blind[k] = np.where(stay, observation.phase, blind[k])
        return np.where(self._unaware, np.choose(self._which, blind), phases).astype(np.int64)


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


class Own(Wrapper):
    """A policy of a user's own, whose every phase must be one: a log has what it decided."""

    def __init__(self, controller: Controller, name: str) -> None:
        """``name`` is what the user calls it."""
        super().__init__(controller)
        self._name = name

    def reset(self, context: ControlContext) -> None:
        """Reset it."""
        self._ids = context.network.ids
        super().reset(context)

    def decide(self, observation: Observation) -> IntArray:
        """(N,): its phases; ``UserError`` where there is none."""
        with named(self._name, "policy", "decide"):
            phases = self.controller.decide(observation)
        if (phases < 0).any():
            words = f"decide gave no phase of {self._ids[int(np.argmin(phases))]}"
            raise UserError("policy", self._name, words, verdict="cannot be used")
        return phases


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


def make_policy(
    names: Sequence[str], switch_at: int | None, epsilon: float, min_space: int = 0
) -> Controller:
    """The policy ``names[0]``, or two in turn, with exploration.

    Where sensors fail each of them runs as it does in ``tsc-run``, with the usual imputer, but
    without its maximum red, and with room kept on roads only as is said here.
    ``min_space`` [vehicles a lane] is what they keep on short roads; 0 for none.
    """
    policy = _make_one(names[0], min_space)
    if switch_at is not None:
        policy = InTurn(policy, _make_one(names[1], min_space), switch_at)
    return Exploring(policy, epsilon)


def _make_one(name: str, min_space: int) -> Controller:
    imputer = str(RunSettings.model_fields["imputer"].default)
    if name == VALUE:
        return roomy(Imputed(make_imputer(imputer), make_one(name)), min_space)
    policy = make_controller(name, imputer, "auto", min_space=min_space)
    return Own(policy, name) if is_own(name) else policy
