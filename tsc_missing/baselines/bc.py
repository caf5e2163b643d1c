"""Behaviour cloning.

The policy is a classifier of the phase that the log's policy took:

    L = −log π(a | s),   π = softmax of the phases' scores over those that the intersection has.

Pomerleau, "ALVINN: an autonomous land vehicle in a neural network", NIPS 1988. The paper cites
Torabi et al., "Behavioral cloning from observation", IJCAI 2018, whose actions are inferred;
here they are in the log.
"""

import torch
from torch import Tensor
from torch.nn import functional

from tsc_missing.baselines.base import Learner, PhasePolicy, accuracy, descend, optimiser_of
from tsc_missing.baselines.config import BCSettings
from tsc_missing.baselines.transitions import Steps


class BC(Learner):
    """Cross-entropy over the phases."""

    def __init__(self, settings: BCSettings) -> None:
        """Fresh weights from torch's global generator."""
        super().__init__()
        self._gradient_norm = settings.gradient_norm
        self.policy: PhasePolicy = PhasePolicy(settings.width)
        self.optimisers = {"policy": optimiser_of([self.policy], settings.learning_rate)}

    def update(self, batch: Steps, step: int, generator: torch.Generator) -> dict[str, float]:
        """Cross-entropy, down its gradient."""
        scores = self.policy.scores(batch, generator)
        loss = cross_entropy(scores, batch.phase[:, -1])
        descend(self.optimisers["policy"], loss, self._gradient_norm)
        return {"loss": loss.item(), "accuracy": accuracy(scores, batch.phase[:, -1])}

    def held_out(self, batch: Steps, generator: torch.Generator) -> dict[str, float]:
        """Cross-entropy and accuracy."""
        scores, phase = self.policy.scores(batch, generator), batch.phase[:, -1]
        return {
            "accuracy": accuracy(scores, phase),
            "cross_entropy": cross_entropy(scores, phase).item(),
        }


def cross_entropy(scores: Tensor, phase: Tensor) -> Tensor:
    """The mean of −log softmax(scores)[phase] over scores (B, N, P) and phases (B, N)."""
    return functional.cross_entropy(scores.flatten(0, 1), phase.flatten())
