"""TD3+BC, for phases.

Fujimoto and Gu, "A minimalist approach to offline reinforcement learning", NeurIPS 2021: TD3
(Fujimoto et al., ICML 2018) whose actor also clones the log. Both are for continuous actions.
Made discrete here, part by part (a: the log's phase, n: the phases that the intersection has):

- the actor π(· | s) is a softmax over the phases, not a point; what it does in the end is its
  most probable phase.
- target policy smoothing: TD3 adds clipped noise to the target actor's action, so that values of
  like actions are like. Phases have no distance, so the noise is a uniform phase with probability
  σ, and as there are few phases its mean is taken instead of a draw:
  y = r + γ Σ_b [(1 − σ) π'(b | s') + σ / n] · min(Q'_1, Q'_2)(s', b).
- the critics minimise huber(Q_j(s, a) − y), j = 1, 2.
- the actor maximises λ Σ_b π(b | s) Q_1(s, b) + log π(a | s): the expected value in the place of
  the value at the actor's point, and the log-likelihood in the place of minus the squared distance
  from the log's action. λ = α / mean |Σ_b π(b | s) Q_1(s, b)| over the batch, as published.
- the actor is updated once in ``policy_delay`` updates of the critics, and the moving averages
  π', Q'_1, Q'_2 then too.

With α = 0 it is behaviour cloning. λ is free of the scale of the rewards but not of their level:
all values here are well below 0 whatever the phase, so α must be larger than the published 2.5
for the same weight of what a phase changes.
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
from tsc_missing.baselines.bc import cross_entropy
from tsc_missing.baselines.config import TD3BCSettings
from tsc_missing.baselines.transitions import Steps
from tsc_missing.qlearning.networks import Graph, PhaseValue


class TD3BC(Learner):
    """An actor, two critics, and the moving averages of the three."""

    length = 2  # a step and the one after

    def __init__(self, settings: TD3BCSettings) -> None:
        """Fresh weights from torch's global generator."""
        super().__init__()
        self._settings = settings
        self.policy: PhasePolicy = PhasePolicy(settings.width)
        self.critics = torch.nn.ModuleList(PhaseValue(settings.width) for _ in range(2))
        self.slow_policy = copy.deepcopy(self.policy).requires_grad_(False)
        self.slow_critics = copy.deepcopy(self.critics).requires_grad_(False)
        self.optimisers = {
            "actor": optimiser_of([self.policy], settings.learning_rate),
            "critics": optimiser_of([self.critics], settings.learning_rate),
        }

    def update(self, batch: Steps, step: int, generator: torch.Generator) -> dict[str, float]:
        """The critics, and at every so many steps the actor and the averages."""
        before, phase = batch.features[:, 0], batch.phase[:, 0]
        wanted = self._target(batch)
        chosen = [of_phase(critic(before, batch.graph), phase) for critic in self.critics]
        td_loss = sum((functional.smooth_l1_loss(q, wanted) for q in chosen), torch.zeros(()))
        descend(self.optimisers["critics"], td_loss, self._settings.gradient_norm)
        logged = {"td_loss": td_loss.item(), "value": chosen[0].mean().item()}
        nothing = dict.fromkeys(("loss", "cross_entropy", "lambda", "accuracy"), torch.nan)
        if step % self._settings.policy_delay:
            return {**logged, **nothing}
        return {**logged, **self._update_actor(batch)}

    def _update_actor(self, batch: Steps) -> dict[str, float]:
        before, phase = batch.features[:, 0], batch.phase[:, 0]
        scores = self.policy.network(before, batch.graph)
        with torch.no_grad():
            values = self.critics[0](before, batch.graph)
        expected = _expected(scores.softmax(dim=-1), values, batch.graph)
        weight = self._settings.alpha / expected.detach().abs().mean().clamp(min=1e-6)
        cloning = cross_entropy(scores, phase)
        loss = cloning - weight * expected.mean()
        descend(self.optimisers["actor"], loss, self._settings.gradient_norm)
        rate = self._settings.target_rate
        follow(self.slow_policy, self.policy, rate)
        follow(self.slow_critics, self.critics, rate)
        return {
            "loss": loss.item(),
            "cross_entropy": cloning.item(),
            "lambda": weight.item(),
            "accuracy": accuracy(scores, phase),
        }

    def held_out(self, batch: Steps, generator: torch.Generator) -> dict[str, float]:
        """How the actor and the first critic stand to the log.

        ``value`` is Q of the log's phases, ``policy_value`` the actor's expected one; ``td_error``
        the mean absolute error of Q of the log's phases.
        """
        before, phase = batch.features[:, 0], batch.phase[:, 0]
        scores, values = (
            net(before, batch.graph) for net in (self.policy.network, *self.critics[:1])
        )
        chosen = of_phase(values, phase)
        expected = _expected(scores.softmax(dim=-1), values, batch.graph)
        return {
            "accuracy": accuracy(scores, phase),
            "cross_entropy": cross_entropy(scores, phase).item(),
            "value": chosen.mean().item(),
            "policy_value": expected.mean().item(),
            "td_error": (chosen - self._target(batch)).abs().mean().item(),
        }

    @torch.no_grad()
    def _target(self, batch: Steps) -> Tensor:
        """(B, N): y."""
        after, graph, share = batch.features[:, 1], batch.graph, self._settings.smoothing
        policy = self.slow_policy.network(after, graph).softmax(dim=-1)
        uniform = graph.phase_mask / graph.phase_mask.sum(dim=-1, keepdim=True)
        first, second = (critic(after, graph) for critic in self.slow_critics)
        later = _expected((1 - share) * policy + share * uniform, first.minimum(second), graph)
        return batch.reward[:, 0] + self._settings.discount * later


def _expected(probability: Tensor, values: Tensor, graph: Graph) -> Tensor:
    """(B, N): the mean of values (B, N, P) over the phases that are there."""
    return (probability * values.masked_fill(~graph.phase_mask, 0.0)).sum(dim=-1)
