"""The temporal U-Net, for the ablation: no neighbours, slots as channels."""

import torch
from torch import Tensor, nn
from torch.nn import functional as nnf

from tsc_missing.diffusion.batch import Inputs, blank
from tsc_missing.diffusion.config import DiffLightConfig
from tsc_missing.diffusion.layers import StepEmbedding, mlp
from tsc_missing.diffusion.noise_model import NoiseModel
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.sensing.observation import N_FEATURES

GROUPS = 8  # of the group normalisation


class Block(nn.Module):
    """Two convolutions over time around the embedding of k and the rewards, with a residual."""

    def __init__(self, inputs: int, outputs: int, width: int) -> None:
        """``width`` is that of the embedding."""
        super().__init__()
        self.first = nn.Sequential(
            nn.Conv1d(inputs, outputs, 5, padding=2), nn.GroupNorm(GROUPS, outputs), nn.SiLU()
        )
        self.condition = nn.Linear(width, outputs)
        self.second = nn.Sequential(
            nn.Conv1d(outputs, outputs, 5, padding=2), nn.GroupNorm(GROUPS, outputs), nn.SiLU()
        )
        self.skip = nn.Conv1d(inputs, outputs, 1)

    def forward(self, x: Tensor, condition: Tensor) -> Tensor:
        """(B, inputs, T') and (B, width) to (B, outputs, T')."""
        middle = self.first(x) + self.condition(condition).unsqueeze(-1)
        out: Tensor = self.second(middle) + self.skip(x)
        return out


class Hourglass(nn.Module):
    """Blocks down twice and up twice over time; T is a multiple of 4."""

    def make_blocks(self, inputs: int, width: int) -> None:
        """``width`` is that of the embedding too."""
        self.enter = Block(inputs, width, width)
        self.down = Block(width, 2 * width, width)
        self.bottom = Block(2 * width, 2 * width, width)
        self.up = Block(4 * width, width, width)
        self.leave = Block(2 * width, width, width)

    def through(self, x: Tensor, condition: Tensor) -> Tensor:
        """(B, inputs, T) and (B, width) to (B, width, T)."""
        top = self.enter(x, condition)
        middle = self.down(nnf.avg_pool1d(top, 2), condition)
        low = self.bottom(nnf.avg_pool1d(middle, 2), condition)
        raised = torch.cat((nnf.interpolate(low, scale_factor=2.0), middle), dim=1)
        full = torch.cat((nnf.interpolate(self.up(raised, condition), scale_factor=2.0), top), 1)
        out: Tensor = self.leave(full, condition)
        return out


class UNet(NoiseModel, Hourglass):
    """An hourglass over the T steps of a window."""

    def __init__(self, config: DiffLightConfig) -> None:
        """Channels are the features of the twelve slots."""
        super().__init__(config)
        width = config.width
        self.channels = N_FEATURES + (not config.inverse_dynamics)
        self.diffusion_step = StepEmbedding(width)
        self.reward = mlp(2 * config.steps, width, width)
        self.make_blocks(N_SLOTS * self.cell_width, width)
        self.out = nn.Conv1d(width, N_SLOTS * self.channels, 1)

    def _predict(
        self, x: Tensor, k: Tensor, inputs: Inputs, reward: Tensor, masks: Tensor
    ) -> Tensor:
        """(R, B, T, L, F)."""
        count, batch, length = masks.shape
        seen = torch.cat((reward * masks, masks.float()), dim=-1)  # (R, B, 2 T)
        used = masks.any(dim=-1)  # without any reward the embedding of rewards is left out
        e = blank(self.reward(seen), used) + self.diffusion_step(k)
        c = e.flatten(0, 1)
        full = self.through(self._features(x, inputs).repeat(count, 1, 1), c)
        out: Tensor = self.out(full).transpose(1, 2)
        return out.reshape(count, batch, length, N_SLOTS, self.channels)

    def _features(self, x: Tensor, inputs: Inputs) -> Tensor:
        """(B, L * features, T)."""
        return self._cells(x, inputs).flatten(2).transpose(1, 2)
