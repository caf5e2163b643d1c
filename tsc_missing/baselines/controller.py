"""Controlling with a baseline's policy."""

from pathlib import Path

import torch
from torch import Tensor

from tsc_missing.baselines.base import Policy
from tsc_missing.baselines.config import BaselineSettings
from tsc_missing.baselines.transitions import Steps
from tsc_missing.baselines.weights import load_policy
from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.scores import best_phases
from tsc_missing.errors import UserError
from tsc_missing.network.model import IntArray
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.qlearning.features import N_NAMES, SlotTables, slot_features
from tsc_missing.qlearning.networks import Graph
from tsc_missing.qlearning.rewards import queue_reward
from tsc_missing.sensing.observation import Observation

THREADS = 1  # the networks are small: more wait for each other


class BaselineController(Controller):
    """The phase with the highest score; needs complete observations.

    It remembers the last observations, as many as the policy looks at, and what came of them: the
    phases that ran, and the rewards, which are read off the values of the step after.
    """

    def __init__(self, policy: Policy, settings: BaselineSettings) -> None:
        """``settings`` are those that the policy was trained with."""
        self._policy = policy
        self._settings = settings
        torch.set_num_threads(THREADS)

    def reset(self, context: ControlContext) -> None:
        """Forget everything and get ready for a run on the context's network."""
        n, history = context.network.n, self._policy.history
        self._tables = SlotTables.of(
            context.network, context.decision_interval, context.detector_length
        )
        self._generator = torch.Generator().manual_seed(context.seed)
        self._recent = Steps(
            graph=Graph.of(context.network),
            features=torch.zeros((1, history, n, N_SLOTS, N_NAMES)),
            phase=torch.full((1, history, n), -1),
            reward=torch.zeros((1, history, n)),
            known=torch.zeros((1, history, n), dtype=torch.bool),
            there=torch.zeros((1, history), dtype=torch.bool),
            position=torch.zeros((1, history), dtype=torch.int64),
            earned=torch.zeros((1, history, n)),
            to_go=torch.full((1, history, n), torch.nan),
        )

    @torch.inference_mode()
    def decide(self, observation: Observation) -> IntArray:
        """(N,): the best phases; raises ``ValueError`` on a hole."""
        self._recent = self._taken(observation)
        scores = self._policy.scores(self._recent, self._generator)
        return best_phases(scores.squeeze(0).double().numpy(), self._settings.algorithm)

    def _taken(self, observation: Observation) -> Steps:
        """The recent steps with a new one; what came of the last one is now known."""
        recent, settings = self._recent, self._settings
        features = slot_features(self._tables, observation.values, observation.red_steps)
        reward = queue_reward(observation.values, settings.running_weight) / settings.reward_scale
        phases, rewards = recent.phase.clone(), recent.reward.clone()
        before = bool(recent.there[0, -1])
        if before:
            phases[0, -1] = torch.from_numpy(observation.phase)
            rewards[0, -1] = torch.from_numpy(reward).float()
        return Steps(
            graph=recent.graph,
            features=_shifted(recent.features, torch.from_numpy(features)),
            phase=_shifted(phases, torch.tensor(-1)),
            reward=_shifted(rewards, torch.tensor(0.0)),
            known=_shifted(recent.known, torch.from_numpy(observation.mask.all(axis=1))),
            there=_shifted(recent.there, torch.tensor(True)),
            position=_shifted(recent.position, recent.position[:, -1] + before),
            earned=_shifted(recent.earned, recent.earned[:, -1] + rewards[:, -1]),
            to_go=recent.to_go,
        )


def _shifted(steps: Tensor, last: Tensor) -> Tensor:
    """(1, K, …): without the oldest step, with ``last`` as the newest."""
    return torch.cat((steps[:, 1:], last.expand_as(steps[:, -1:])), dim=1)


def make_baseline(name: str, weights: Path) -> BaselineController:
    """The baseline ``name`` with these weights; ``UserError`` if they are others'."""
    policy, settings, _ = load_policy(weights)
    if settings.algorithm != name:
        raise UserError("q_weights", weights, f"they are of {settings.algorithm}, not of {name}")
    return BaselineController(policy, settings)
