"""The DDIM sampler with η = 0: the reverse process, from noise to a trajectory."""

import itertools
from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from tsc_missing.diffusion.schedule import CosineSchedule

Denoiser = Callable[[Tensor, Tensor], Tensor]
"""(x^k, k (1,)) to x̂^0, all but k of the shape of x^k."""

Hook = Callable[[Tensor, Tensor], Tensor]
"""Called after every reverse step with (x^{k-1}, x̂^0); gives the x^{k-1} to go on with."""


def sample(
    schedule: CosineSchedule, denoise: Denoiser, x: Tensor, ks: Sequence[int], after_step: Hook
) -> Tensor:
    """x^0 from ``x`` = x^K by reverse steps from each of ``ks`` to the next; deterministic.

    x^{k'} = sqrt(ᾱ^{k'}) x̂^0 + sqrt(1 - ᾱ^{k'}) ε̂ for the next k' after k, where ε̂
    is the noise that belongs to x^k and x̂^0 (section "Diffusion model").
    """
    for k, smaller in itertools.pairwise(ks):
        now, then = torch.tensor([k]), torch.tensor([smaller])
        x0 = denoise(x, now)
        noise = schedule.noise_from_x0(x, now, x0)
        x = after_step(schedule.q_sample(x0, then, noise), x0)
    return x
