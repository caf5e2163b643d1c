"""What every baseline is made of: a policy that decides, and a learner that makes it."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable

import torch
from torch import Tensor, nn

from tsc_missing.baselines.transitions import Logs, Steps
from tsc_missing.qlearning.networks import PhaseValue


class NotFiniteError(RuntimeError):
    """A loss or its gradient is not finite; nothing was changed by it."""


class Policy(nn.Module, ABC):
    """What decides; its state is what a weights file holds."""

    history = 1  # K steps that a decision looks at, the present the last

    @abstractmethod
    def scores(self, recent: Steps, generator: torch.Generator) -> Tensor:
        """(B, N, P): the best is the phase to run now; ``NO_PHASE`` where there is no such phase.

        ``recent`` are K steps or more; phase and reward of the last, which is now, must not
        matter, nor what is ``to_go``. What is random comes from ``generator``.
        """


class PhasePolicy(Policy):
    """Scores the phases by what is known now, with weights shared over the intersections."""

    def __init__(self, width: int) -> None:
        """A network of the form of ``PhaseValue``."""
        super().__init__()
        self.network = PhaseValue(width)

    def scores(self, recent: Steps, generator: torch.Generator) -> Tensor:
        """(B, N, P) of the last step."""
        found: Tensor = self.network(recent.features[:, -1], recent.graph)
        return found


class Learner(nn.Module, ABC):
    """A policy, what else is learned to make it, and the optimisers of all that.

    All that an update changes is in ``state_dict`` or in the optimisers, so that a training that
    was stopped goes on as if it had not been.
    """

    length = 1  # K steps of a sample
    padded = False  # whether samples may reach back to before an episode
    ahead = 0  # steps of a sample after the one that is decided at; never padding
    discount = 1.0  # of the next step, in what samples tell of the rewards to go
    takes_holes = False  # whether it learns from logs with holes

    policy: Policy
    optimisers: dict[str, torch.optim.Optimizer]

    def prepare(self, logs: Logs) -> None:
        """Measure what is needed of the logs, before the first update.

        What is found is in ``state_dict`` too. Nothing, unless a learner does more.
        """
        return

    @abstractmethod
    def update(self, batch: Steps, step: int, generator: torch.Generator) -> dict[str, float]:
        """Learn from a batch; what to log of it, always under the same names, NaN for nothing.

        Raises ``NotFiniteError``.
        """

    @abstractmethod
    def held_out(self, batch: Steps, generator: torch.Generator) -> dict[str, float]:
        """Numbers that tell how good it is, means over the samples; under the same names always.

        ``accuracy`` is the share of the log's phases that the policy would have taken.
        """


def optimiser_of(modules: Iterable[nn.Module], rate: float) -> torch.optim.Optimizer:
    """Adam over the weights of some modules."""
    return torch.optim.Adam([w for module in modules for w in module.parameters()], rate)


def descend(optimiser: torch.optim.Optimizer, loss: Tensor, most: float) -> None:
    """One step down the gradient of ``loss``, cut to the norm ``most``.

    Raises ``NotFiniteError`` instead, where the loss or the gradient is not finite.
    """
    weights = [w for group in optimiser.param_groups for w in group["params"]]
    optimiser.zero_grad(set_to_none=True)
    loss.backward()  # type: ignore[no-untyped-call]
    norm = nn.utils.clip_grad_norm_(weights, most)
    if not (math.isfinite(loss.item()) and math.isfinite(norm.item())):
        raise NotFiniteError(f"the loss is {loss.item()} or its gradient is not finite")
    optimiser.step()


def follow(slow: nn.Module, fast: nn.Module, rate: float) -> None:
    """Move the weights of ``slow`` a part of the way to those of ``fast``."""
    with torch.no_grad():
        for s, f in zip(slow.parameters(), fast.parameters(), strict=True):
            s.lerp_(f, rate)


def of_phase(scores: Tensor, phase: Tensor) -> Tensor:
    """(B, N): of the scores (B, N, P) those of the phases (B, N)."""
    return scores.gather(-1, phase.unsqueeze(-1)).squeeze(-1)


def accuracy(scores: Tensor, phase: Tensor) -> float:
    """The share of phases (B, N) that the scores (B, N, P) are highest for."""
    return (scores.argmax(dim=-1) == phase).float().mean().item()
