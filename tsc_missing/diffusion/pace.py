"""Fewer reverse steps for most rows of a plan: what is seen needs less than what is not."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from tsc_missing.diffusion.batch import Inputs
from tsc_missing.diffusion.ddim import Denoiser

Estimate = Callable[[Tensor, Tensor, Inputs], Tensor]  # x^k, k (1,) and inputs to x̂^0


@dataclass(frozen=True)
class Pace:
    """Which rows of a plan take all of its reverse steps; the others take ``few``."""

    rows: Tensor  # (R,)
    few: int  # at least 1


def paced(
    estimate: Estimate,
    inputs: Callable[[bool], Inputs],
    ks: Sequence[int],
    pace: Pace | None,
) -> Denoiser:
    """A denoiser for the reverse steps ``ks``; by a ``pace`` only at ``few`` of them of all rows.

    Between them only ``pace.rows`` are estimated; the others keep their last x̂^0, which for DDIM
    is one longer step. ``inputs`` gives those of the reverse step that is due, of all rows or only
    of ``pace.rows``.
    """
    if pace is None:
        return lambda x, k: estimate(x, k, inputs(False))
    steps = len(ks) - 1
    rows, few = pace.rows, min(pace.few, steps)
    full = {ks[round(turn * steps / few)] for turn in range(few)}
    held = torch.empty(0)

    def denoise(x: Tensor, k: Tensor) -> Tensor:
        nonlocal held
        if int(k) in full:
            held = estimate(x, k, inputs(False))
        else:
            held = held.clone()
            held[rows] = estimate(x[rows], k, inputs(True))
        return held

    return denoise
