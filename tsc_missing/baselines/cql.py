"""Conservative Q-learning, for phases.

Values of phases by double Q-learning, kept low for phases that the log does not have:

    L = huber(Q(s, a) − y) + α · (log Σ_a' exp Q(s, a') − Q(s, a)),
    y = r + γ Q'(s', argmax_a' Q(s', a')),

with the sum and the maximum over the phases that the intersection has, and Q' the moving average
of Q, which also decides in the end. The second term is CQL(H), equation 4 of Kumar et al.,
"Conservative Q-learning for offline reinforcement learning", NeurIPS 2020; y is from van Hasselt
et al., "Deep reinforcement learning with double Q-learning", AAAI 2016.

What α means depends on the scale of the rewards: where the values of two phases differ by less
than α, the policy is that of the log.
"""

import copy

import torch
from torch import Tensor
from torch.nn import functional

from tsc_missing.baselines.base import (
    Learner,
    PhasePolicy,
    accuracy,
    descend,
    follow,
    of_phase,
    optimiser_of,
)
from tsc_missing.baselines.config import CQLSettings
from tsc_missing.baselines.transitions import Steps
from tsc_missing.qlearning.networks import PhaseValue


class CQL(Learner):
    """A Q-network and its moving average."""

    length = 2  # a step and the one after

    def __init__(self, settings: CQLSettings) -> None:
        """Fresh weights from torch's global generator."""
        super().__init__()
        self._settings = settings
        self.network = PhaseValue(settings.width)
        self.policy: PhasePolicy = PhasePolicy(settings.width).requires_grad_(False)
        self.policy.network.load_state_dict(copy.deepcopy(self.network.state_dict()))
        self.optimisers = {"values": optimiser_of([self.network], settings.learning_rate)}

    def update(self, batch: Steps, step: int, generator: torch.Generator) -> dict[str, float]:
        """One step down the gradient of L, and the average after it."""
        values = self.network(batch.features[:, 0], batch.graph)
        chosen = of_phase(values, batch.phase[:, 0])
        error = functional.smooth_l1_loss(chosen, self._target(batch))
        conservative = (values.logsumexp(dim=-1) - chosen).mean()
        loss = error + self._settings.alpha * conservative
        descend(self.optimisers["values"], loss, self._settings.gradient_norm)
        follow(self.policy.network, self.network, self._settings.target_rate)
        return {
            "loss": loss.item(),
            "td_loss": error.item(),
            "conservative": conservative.item(),
            "value": chosen.mean().item(),
        }

    def held_out(self, batch: Steps, generator: torch.Generator) -> dict[str, float]:
        """How the deciding values stand to the log.

        ``value`` is Q of the log's phases, ``best_value`` that of the phases it would take;
        ``td_error`` the mean absolute error of Q of the log's phases.
        """
        values = self.policy.network(batch.features[:, 0], batch.graph)
        chosen = of_phase(values, batch.phase[:, 0])
        return {
            "accuracy": accuracy(values, batch.phase[:, 0]),
            "value": chosen.mean().item(),
            "best_value": values.max(dim=-1).values.mean().item(),
            "td_error": (chosen - self._target(batch)).abs().mean().item(),
        }

    def reward(self, batch: Steps) -> Tensor:
        """(B, N): of the first step, scaled."""
        return batch.reward[:, 0]

    @torch.no_grad()
    def _target(self, batch: Steps) -> Tensor:
        """(B, N): y."""
        after = batch.features[:, 1]
        best = self.network(after, batch.graph).argmax(dim=-1)
        later = of_phase(self.policy.network(after, batch.graph), best)
        return self.reward(batch) + self._settings.discount * later
