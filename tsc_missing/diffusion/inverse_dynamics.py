"""Which phase leads from one observation to the next."""

import torch
from torch import Tensor, nn

from tsc_missing.diffusion.batch import blank
from tsc_missing.diffusion.layers import mlp
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.sensing.observation import N_FEATURES


class InverseDynamics(nn.Module):
    """a_t = f_φ(o_t, o_{t+1}) (Eq. inverse-dynamics), through the slots that a phase serves.

    A slot's score comes from its own two observations and from the mean over the intersection;
    the logit of a phase is the mean score of its slots, so any phase table can be scored.
    """

    def __init__(self, width: int) -> None:
        """``width`` of the hidden layers."""
        super().__init__()
        self.embed = mlp(2 * N_FEATURES, width, width)
        self.slot = nn.Parameter(torch.zeros(N_SLOTS, width))
        self.score = mlp(2 * width, width, 1)

    def forward(
        self, now: Tensor, then: Tensor, slots: Tensor, phases: Tensor, phase_mask: Tensor
    ) -> Tensor:
        """Logits (B, P), -inf for phases that are not there.

        ``now`` and ``then`` (B, L, F) scaled, ``slots`` (B, L), ``phases`` (B, P, L),
        ``phase_mask`` (B, P).
        """
        change = blank(torch.cat((now, then), dim=-1), slots)
        e = torch.nn.functional.silu(self.embed(change) + self.slot)
        there = slots.unsqueeze(-1).float()
        mean = (e * there).sum(dim=1) / there.sum(dim=1).clamp(min=1)
        around = mean.unsqueeze(1).expand_as(e)
        score = self.score(torch.cat((e, around), dim=-1))  # (B, L, 1)
        return phase_means(score.squeeze(-1), slots, phases, phase_mask)


def phase_means(score: Tensor, slots: Tensor, phases: Tensor, phase_mask: Tensor) -> Tensor:
    """(B, P): the mean of ``score`` (B, L) over the slots of each phase, -inf without the phase."""
    served = (phases & slots.unsqueeze(1)).float()
    total = (served @ torch.where(slots, score, 0.0).unsqueeze(-1)).squeeze(-1)
    mean = total / served.sum(dim=2).clamp(min=1)
    return mean.masked_fill(~phase_mask, -torch.inf)
