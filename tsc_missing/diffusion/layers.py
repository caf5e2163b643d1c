"""Small parts that the networks share."""

import math

import torch
from torch import Tensor, nn
from torch.nn import functional as nnf


class Dense(nn.Linear):
    """A linear layer that works in its input's precision; the weights stay in float32."""

    def forward(self, x: Tensor) -> Tensor:
        """(…, in) to (…, out)."""
        return nnf.linear(x, self.weight.to(x.dtype), self.bias.to(x.dtype))


class Projection(nn.Module):
    """``parts`` of queries, keys and values without biases; the queries divided by sqrt(d)."""

    scale: Tensor

    def __init__(self, width: int, heads: int, parts: str) -> None:
        """``parts`` are letters: "q", "kv" or "qkv"; each is ``width`` wide."""
        super().__init__()
        self.weight = nn.Parameter(torch.empty(len(parts) * width, width))
        nn.init.uniform_(self.weight, -(width**-0.5), width**-0.5)
        scale = torch.ones(len(parts) * width, 1)
        if parts.startswith("q"):
            scale[:width] = (width // heads) ** -0.5
        self.register_buffer("scale", scale, persistent=False)

    def forward(self, x: Tensor) -> Tensor:
        """(…, D) to (…, parts * D)."""
        return nnf.linear(x, (self.weight * self.scale).to(x.dtype))


def mlp(inputs: int, hidden: int, outputs: int) -> nn.Sequential:
    """f_MLP of the paper: two linear layers."""
    return nn.Sequential(Dense(inputs, hidden), nn.ReLU(), Dense(hidden, outputs))


class StepEmbedding(nn.Module):
    """A step number to an embedding: sines and cosines, then an MLP."""

    frequencies: Tensor

    def __init__(self, width: int) -> None:
        """``width`` is D."""
        super().__init__()
        half = width // 2
        frequencies = torch.exp(-math.log(1e4) * torch.arange(half) / max(half - 1, 1))
        self.register_buffer("frequencies", frequencies, persistent=False)
        self.mlp = mlp(2 * half, width, width)

    def forward(self, step: Tensor) -> Tensor:
        """(B,) to (B, D)."""
        angle = step.float().unsqueeze(-1) * self.frequencies
        out: Tensor = self.mlp(torch.cat((angle.sin(), angle.cos()), dim=-1))
        return out
