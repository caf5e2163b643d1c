"""Decision Transformer.

A causal transformer over the last K steps of one intersection, with three tokens a step,

    R̂_t, s_t, a_t,   R̂_t = r_t + r_{t+1} + … to the end of the episode,

says which phase follows s_t: L = −log π(a_t | R̂_{t−K+1}, s_{t−K+1}, a_{t−K+1}, …, R̂_t, s_t),
averaged over the K steps. A run begins with the return that is asked for, a quantile of those in
the logs, and takes off it what has been earned. Chen et al., "Decision Transformer: reinforcement
learning via sequence modeling", NeurIPS 2021.

R̂_t is given as the mean of the rewards to go, which with the step's number, given too, is the
same. The tokens of phases are made of the slots that they serve, and phases are scored through
these, so no phase table is built in. There is no dropout.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from tsc_missing.baselines.base import Learner, Policy, accuracy, descend, optimiser_of
from tsc_missing.baselines.config import DecisionTransformerSettings
from tsc_missing.baselines.returns import ReturnScale
from tsc_missing.baselines.transitions import Logs, Steps, served_slots
from tsc_missing.diffusion.attention import attend, merge_heads, split_heads
from tsc_missing.diffusion.layers import Projection, StepEmbedding, mlp
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.qlearning.features import NAMES
from tsc_missing.qlearning.networks import (
    NO_PHASE,
    SlotEmbedding,
    dense,
    running_phase,
    served,
)

TOKENS = 3  # of a step: return to go, state, phase
STATE = 1  # which of them the phase is read off


class DecisionTransformerPolicy(Policy):
    """π, and the return that a run asks for."""

    last: Tensor

    def __init__(self, settings: DecisionTransformerSettings) -> None:
        """Fresh weights from torch's global generator."""
        super().__init__()
        width = settings.width
        self.history = settings.history
        self.heads = settings.heads
        self.returns = ReturnScale()
        self.register_buffer("last", torch.tensor(0))  # position that the longest log ends at
        self.to_go = nn.Linear(1, width)
        self.slot = SlotEmbedding(NAMES, width)
        self.state = nn.Linear(width, width)
        self.phase = nn.Linear(N_SLOTS, width)
        self.position = StepEmbedding(width)
        self.place = nn.Parameter(0.02 * torch.randn(self.history, TOKENS, width))
        self.layers = nn.ModuleList(Layer(width, self.heads) for _ in range(settings.layers))
        self.out = nn.LayerNorm(width)
        self.score = dense(4 * width + 1, 2 * width, width, 1)

    def scores(self, recent: Steps, generator: torch.Generator) -> Tensor:
        """(B, N, P): logits of the last step's phases, for the return that is asked for."""
        return self.logits(recent, self.asked_to_go(recent))[:, -1]

    def asked_to_go(self, steps: Steps) -> Tensor:
        """(B, K, N): the mean reward that is left to ask for; none is better than 0."""
        left = (self.last - steps.position).clamp(min=1).unsqueeze(-1)
        left_to_earn = self.returns.asked * self.last - steps.earned
        return (left_to_earn / left).clamp(max=0)

    def logits(self, steps: Steps, to_go: Tensor) -> Tensor:
        """(B, K, N, P) for what is to go (B, K, N), of the last K steps; of each from its past."""
        count = self.history
        x, phase, there = (part[:, -count:] for part in (steps.features, steps.phase, steps.there))
        e = self.slot(x)
        tokens = torch.stack(
            (
                self.to_go(self.returns(to_go[:, -count:]).unsqueeze(-1)),
                self.state(e.sum(dim=-2)),
                self.phase(served_slots(steps.graph, phase)),
            ),
            dim=3,
        )  # (B, K, N, 3, D)
        position = steps.position[:, -count:].clamp(max=self.last)
        tokens = tokens + self.position(position)[:, :, None, None] + self.place[:, None]
        h = self._transformed(tokens, there)
        mine = served(steps.graph, e)  # (B, K, N, P, D)
        others = e.sum(dim=-2).unsqueeze(-2) - mine
        any_phase = steps.graph.phases.any(dim=1, keepdim=True).float() @ e
        around = (part.expand_as(mine) for part in (any_phase, h.unsqueeze(-2)))
        parts = (mine, others, *around, running_phase(steps.graph, x))
        found: Tensor = self.score(torch.cat(parts, dim=-1)).squeeze(-1)
        return found.masked_fill(~steps.graph.phase_mask, NO_PHASE)

    def _transformed(self, tokens: Tensor, there: Tensor) -> Tensor:
        """(B, K, N, D) of tokens (B, K, N, 3, D): what the state tokens become."""
        batch, count, n, _, width = tokens.shape
        h = tokens.transpose(1, 2).reshape(batch * n, count * TOKENS, width)
        seen = seen_from(there).float().repeat_interleave(n, dim=0).repeat(self.heads, 1, 1)
        for layer in self.layers:
            h = layer(h, seen)
        out: Tensor = self.out(h)
        return out.view(batch, n, count, TOKENS, width)[:, :, :, STATE].transpose(1, 2)


class Layer(nn.Module):
    """Attention and an MLP, each after a normalisation and with a residual."""

    def __init__(self, width: int, heads: int) -> None:
        """``width`` is a multiple of ``heads``."""
        super().__init__()
        self.heads = heads
        self.before = nn.LayerNorm(width)
        self.project = Projection(width, heads, "qkv")
        self.merge = nn.Linear(width, width)
        self.between = nn.LayerNorm(width)
        self.mlp = mlp(width, 4 * width, width)

    def forward(self, h: Tensor, seen: Tensor) -> Tensor:
        """(S, Q, D) of the same; ``seen`` (heads * S, Q, Q), 1 where a row sees a column."""
        q, k, v = split_heads(self.project(self.before(h)), 3, self.heads)
        h = h + self.merge(merge_heads(attend(q, k, v, seen), self.heads))
        out: Tensor = h + self.mlp(self.between(h))
        return out


class DecisionTransformer(Learner):
    """Cross-entropy over the phases of all steps of a stretch."""

    padded = True

    def __init__(self, settings: DecisionTransformerSettings) -> None:
        """Fresh weights from torch's global generator."""
        super().__init__()
        self.length = settings.history
        self._quantile = settings.asked_quantile
        self._gradient_norm = settings.gradient_norm
        self.policy: DecisionTransformerPolicy = DecisionTransformerPolicy(settings)
        self.optimisers = {"policy": optimiser_of([self.policy], settings.learning_rate)}

    def prepare(self, logs: Logs) -> None:
        """Measure the returns of whole episodes."""
        self.policy.returns.measure(logs.returns(whole=True), self._quantile)
        self.policy.last.fill_(max(logs.steps - 1, 1))

    def update(self, batch: Steps, step: int, generator: torch.Generator) -> dict[str, float]:
        """Cross-entropy given the returns of the logs, down its gradient."""
        logits = self.policy.logits(batch, batch.to_go)
        loss = _cross_entropy(logits, batch)
        descend(self.optimisers["policy"], loss, self._gradient_norm)
        return {"loss": loss.item(), "accuracy": accuracy(logits[:, -1], batch.phase[:, -1])}

    def held_out(self, batch: Steps, generator: torch.Generator) -> dict[str, float]:
        """Accuracy with the return that a run asks for, and with the log's own."""
        told = self.policy.logits(batch, batch.to_go)
        phase = batch.phase[:, -1]
        return {
            "accuracy": accuracy(self.policy.scores(batch, generator), phase),
            "told_accuracy": accuracy(told[:, -1], phase),
            "cross_entropy": _cross_entropy(told, batch).item(),
        }


def seen_from(there: Tensor) -> Tensor:
    """(B, 3 K, 3 K): whether a token (row) sees another (column); ``there`` (B, K).

    It sees itself and those before it, but no padding.
    """
    told = there.repeat_interleave(TOKENS, dim=1).unsqueeze(1)
    past = torch.ones((told.shape[-1], told.shape[-1]), dtype=torch.bool).tril()
    return (past & told) | torch.eye(len(past), dtype=torch.bool)


def _cross_entropy(logits: Tensor, batch: Steps) -> Tensor:
    """The mean over the steps that are there, of logits (B, K, N, P)."""
    return functional.cross_entropy(
        logits[batch.there].flatten(0, 1), batch.phase[batch.there].flatten()
    )
