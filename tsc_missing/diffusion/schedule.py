"""The noise schedule, apart from the model."""

import math

import torch
from torch import Tensor


class CosineSchedule:
    """Variances of the forward process q(x^k | x^{k-1}) = N(sqrt(1 - β^k) x^{k-1}, β^k I).

    The paper's symbol to the variable: K ``steps``; β^k ``beta[k]``; α^k ``1 - beta[k]``;
    ᾱ^k ``alpha_bar[k]``; k = 0 is the clean trajectory, with ᾱ^0 = 1. The cosine form is that of
    Nichol and Dhariwal (2021): ᾱ^k = f(k) / f(0), f(k) = cos²((k / K + s) / (1 + s) · π / 2).
    """

    OFFSET = 0.008  # s
    MAX_BETA = 0.999

    def __init__(self, steps: int) -> None:
        """``steps`` is K."""
        self.steps = steps

        def f(k: int) -> float:
            return math.cos((k / steps + self.OFFSET) / (1 + self.OFFSET) * math.pi / 2) ** 2

        beta = [0.0] + [min(1 - f(k) / f(k - 1), self.MAX_BETA) for k in range(1, steps + 1)]
        self.beta = torch.tensor(beta, dtype=torch.float64)  # (K + 1,)
        self.alpha_bar = torch.cumprod(1 - self.beta, dim=0)  # (K + 1,)
        self._signal = self.alpha_bar.sqrt().float()  # sqrt(ᾱ^k)
        self._noise = (1 - self.alpha_bar).sqrt().float()  # sqrt(1 - ᾱ^k)

    def _at(self, k: Tensor, x: Tensor) -> tuple[Tensor, Tensor]:
        shape = (-1, *[1] * (x.dim() - 1))
        return self._signal[k].view(shape), self._noise[k].view(shape)

    def q_sample(self, x0: Tensor, k: Tensor, noise: Tensor) -> Tensor:
        """x^k = sqrt(ᾱ^k) x^0 + sqrt(1 - ᾱ^k) ε; ``x0``, ``noise`` (B, …), ``k`` (B,) or (1,)."""
        signal, scale = self._at(k, x0)
        return signal * x0 + scale * noise

    def x0_from_noise(self, x: Tensor, k: Tensor, noise: Tensor) -> Tensor:
        """x̂^0 = (x^k - sqrt(1 - ᾱ^k) ε) / sqrt(ᾱ^k)."""
        signal, scale = self._at(k, x)
        return (x - scale * noise) / signal

    def noise_from_x0(self, x: Tensor, k: Tensor, x0: Tensor) -> Tensor:
        """ε = (x^k - sqrt(ᾱ^k) x^0) / sqrt(1 - ᾱ^k), for k > 0."""
        signal, scale = self._at(k, x)
        return (x - signal * x0) / scale

    def sampling_steps(self, count: int, *, leading: bool = False) -> list[int]:
        """``count`` values of k, evenly spaced, and the 0 that they lead to.

        From K down, or ``leading``, so that the last one is 1 and the first as far from K. A model
        that predicts the noise needs the latter (Lin et al., WACV 2024, "Common diffusion noise
        schedules and sample steps are flawed", section 3): ᾱ^K is 2e-7, and x̂^0 from a noise that
        is off by 0.01 is off by 20 there.
        """
        if not 1 <= count <= self.steps:
            raise ValueError(f"{count} sampling steps: must be 1 to {self.steps}")
        jumps = range(count, 0, -1)
        if leading:
            return [*(1 + self.steps * (j - 1) // count for j in jumps), 0]
        return [*(round(self.steps * j / count) for j in jumps), 0]
