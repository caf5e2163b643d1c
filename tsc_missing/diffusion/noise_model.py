"""What the two noise models have in common."""

from abc import ABC, abstractmethod

import torch
from torch import Tensor, nn

from tsc_missing.diffusion.batch import Inputs
from tsc_missing.diffusion.config import DiffLightConfig, Precision

COMPUTE = {"float32": torch.float32, "bfloat16": torch.bfloat16}


class NoiseModel(nn.Module, ABC):
    """Predicts the noise in x^k, or x^0, with and without the reward."""

    def __init__(self, config: DiffLightConfig) -> None:
        """Keep what both need."""
        super().__init__()
        self.padded_rewards = config.padded_rewards
        self.precision: Precision = "float32"

    def forward(self, x: Tensor, k: Tensor, inputs: Inputs, keep: Tensor) -> Tensor:
        """The prediction (B, T, L, F) for x^k (B, T, L, F) and k (B,) or (1,).

        ``keep`` (B,) tells which windows are denoised with their rewards.
        """
        reward, mask = self._reward(inputs)
        return self._predict(x, k, inputs, reward, (mask & keep.unsqueeze(1)).unsqueeze(0))[0]

    def branches(self, x: Tensor, k: Tensor, inputs: Inputs) -> tuple[Tensor, Tensor]:
        """ε(r) and ε(φ), each (B, T, L, F), in one pass."""
        reward, mask = self._reward(inputs)
        masks = torch.stack((mask, torch.zeros_like(mask)))
        with_reward, without = self._predict(x, k, inputs, reward, masks).unbind(0)
        return with_reward, without

    def _reward(self, inputs: Inputs) -> tuple[Tensor, Tensor]:
        """r(τ) (B, T), and the steps (B, T) whose reward counts: where padded, the zeros too."""
        known = inputs.reward_known
        reward = torch.where(known, inputs.reward, 0.0)
        return reward, torch.ones_like(known) if self.padded_rewards else known

    @abstractmethod
    def _predict(
        self, x: Tensor, k: Tensor, inputs: Inputs, reward: Tensor, masks: Tensor
    ) -> Tensor:
        """(R, B, T, L, F) for R masks (R, B, T) of the rewards (B, T)."""
