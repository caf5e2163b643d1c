"""What the two noise models have in common."""

from abc import ABC, abstractmethod

import torch
from torch import Tensor, nn

from tsc_missing.diffusion.batch import N_SIGNALS, Downstream, Inputs, blank
from tsc_missing.diffusion.config import DiffLightConfig, Precision
from tsc_missing.sensing.observation import N_FEATURES

N_DOWNSTREAM = N_FEATURES + 2  # of a road downstream: its values, whether told, whether there

COMPUTE = {"float32": torch.float32, "bfloat16": torch.bfloat16}


class NoiseModel(nn.Module, ABC):
    """Predicts the noise in x^k, or x^0, with and without the reward."""

    def __init__(self, config: DiffLightConfig) -> None:
        """Keep what both need."""
        super().__init__()
        self.padded_rewards = config.padded_rewards
        self.known_flag = config.known_flag
        self.own_signals = config.own_signals
        beside = config.neighbours and config.noise_model != "unet"
        self.downstream = config.downstream and beside
        self.cell_width = (
            N_FEATURES
            + (not config.inverse_dynamics)
            + config.known_flag
            + N_SIGNALS * config.own_signals
            + N_DOWNSTREAM * self.downstream
        )
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

    def _cells(self, x: Tensor, inputs: Inputs) -> Tensor:
        """(B, T, L, cell_width): x^k (B, T, L, F) and what else is known of each cell."""
        features = [x]
        if self.known_flag:
            features.append(inputs.known.unsqueeze(-1).float())
        if self.own_signals:
            features.append(inputs.signals)
        if self.downstream:
            features.append(_roads_downstream(inputs.downstream))
        return blank(torch.cat(features, dim=-1), inputs.slots.unsqueeze(1))

    @abstractmethod
    def _predict(
        self, x: Tensor, k: Tensor, inputs: Inputs, reward: Tensor, masks: Tensor
    ) -> Tensor:
        """(R, B, T, L, F) for R masks (R, B, T) of the rewards (B, T)."""


def _roads_downstream(roads: Downstream) -> Tensor:
    """(B, T, L, N_DOWNSTREAM)."""
    given = roads.given.unsqueeze(-1).float()
    exists = roads.exists[:, :, None, None].float().expand_as(given)
    told = torch.cat((blank(roads.values, roads.given), given, exists), dim=-1)
    return told.transpose(1, 2)
