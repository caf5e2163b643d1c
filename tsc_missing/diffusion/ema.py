"""The exponential moving average of the weights, which is what decides at inference."""

import copy

import torch
from torch import Tensor

from tsc_missing.diffusion.difflight import DiffLightModel


class Ema:
    """w̄ ← d w̄ + (1 - d) w, with d = min(``decay``, (1 + n) / (10 + n)) at the n-th update."""

    def __init__(self, model: DiffLightModel, decay: float = 0.999) -> None:
        """Start from the model's weights."""
        self.model = copy.deepcopy(model).requires_grad_(False).eval()
        self.decay = decay
        self.updates = 0

    def update(self, model: DiffLightModel) -> None:
        """Take in the model's weights; call it after every optimiser step."""
        self.updates += 1
        decay = min(self.decay, (1 + self.updates) / (10 + self.updates))
        with torch.no_grad():
            torch._foreach_lerp_(list(self.model.parameters()), list(model.parameters()), 1 - decay)

    def state_dict(self) -> dict[str, Tensor]:
        """The averages and how often they were updated, for a checkpoint."""
        return {**self.model.state_dict(), "updates": torch.tensor(self.updates)}

    def load_state_dict(self, state: dict[str, Tensor]) -> None:
        """Go on from a checkpoint."""
        weights = dict(state)
        self.updates = int(weights.pop("updates"))
        self.model.load_state_dict(weights)
