"""Measurements to model inputs and back: the one place of scales and clips."""

import torch
from torch import Tensor

from tsc_missing.diffusion.config import ScalingSettings


class Scaling:
    """Divides features by fixed scales, clips them, and maps rewards to 1 (best) … 0 (worst)."""

    def __init__(self, settings: ScalingSettings) -> None:
        """Keep the scales."""
        self.settings = settings
        self._scale = torch.tensor([settings.vehicles, settings.queue])  # (F,) [vehicles]

    def values(self, vehicles: Tensor) -> Tensor:
        """(…, F) vehicles and queue [vehicles] to 0 … clip; NaN stays NaN."""
        return (vehicles.float() / self._scale).clamp(0, self.settings.clip)

    def vehicles(self, values: Tensor) -> Tensor:
        """The inverse of ``values``, [vehicles]."""
        return values * self._scale

    def reward(self, reward: Tensor) -> Tensor:
        """Minus the vehicles queueing at an intersection, to 1 for none … 0; NaN stays NaN."""
        return (1 + reward.float() / self.settings.reward).clamp(0, 1)

    def signals(self, green: Tensor, red_steps: Tensor, steps: int) -> Tensor:
        """(B, C, L) green and decision steps since the last green, to (B, T, L, 2) in 0 … 1.

        What the signals will do after now is not known; it is 0.
        """
        red = (red_steps.float() / self.settings.red_steps).clamp(0, 1)
        past = torch.stack((green.float(), red), dim=-1)
        return torch.nn.functional.pad(past, (0, 0, 0, 0, 0, steps - past.shape[1]))
