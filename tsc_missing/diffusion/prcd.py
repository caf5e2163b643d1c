"""Partial rewards conditioned diffusion: who is denoised with the reward, and who without."""

import torch
from torch import Tensor


def combine(with_reward: Tensor, without: Tensor, observable: Tensor, guidance: float) -> Tensor:
    """ε̂ = m_obs ⊙ [ε(φ) + ω (ε(r) - ε(φ))] + m_mis ⊙ ε(φ) (Eq. PRCD, PRCD-classifier-free).

    ``with_reward`` ε(r) and ``without`` ε(φ) are (B, T, L, F), ``observable`` m_obs (B, T, L).
    As x̂^0 is affine in ε̂ for a given x^k, the same sum holds for predictions of x^0.
    """
    guided = torch.lerp(without, with_reward, guidance)
    return torch.where(observable.unsqueeze(-1), guided, without)
