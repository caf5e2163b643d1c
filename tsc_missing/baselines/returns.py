"""Returns as inputs of networks."""

import torch
from torch import Tensor, nn


class ReturnScale(nn.Module):
    """Returns less their mean in the logs, in standard deviations; and the one to ask for."""

    mean: Tensor
    spread: Tensor
    asked: Tensor

    def __init__(self) -> None:
        """Scale 1, until the logs are measured."""
        super().__init__()
        for name, value in {"mean": 0.0, "spread": 1.0, "asked": 0.0}.items():
            self.register_buffer(name, torch.tensor(value))

    def measure(self, returns: Tensor, quantile: float) -> None:
        """Take mean and spread of returns (R,), and ask for a quantile of them from now on."""
        self.mean.copy_(returns.mean())
        self.spread.copy_(returns.std(correction=0).clamp(min=1e-3))
        ranked = returns.sort().values
        self.asked.copy_(ranked[round(quantile * (len(ranked) - 1))])

    def forward(self, returns: Tensor) -> Tensor:
        """Scaled, of the same shape."""
        scaled: Tensor = (returns - self.mean) / self.spread
        return scaled
