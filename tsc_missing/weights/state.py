"""Parts of a training's state as named tensors, for checkpoints."""

from collections.abc import Mapping

import torch
from torch import Tensor, nn


def under(part: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Copies of tensors under the name of their part: ``part/name``."""
    return {f"{part}/{name}": tensor.contiguous().clone() for name, tensor in tensors.items()}


def part_of(part: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The tensors of a part, by their names in it."""
    start = f"{part}/"
    return {name.removeprefix(start): t for name, t in tensors.items() if name.startswith(start)}


def optimiser_state(model: nn.Module, optimiser: torch.optim.Optimizer) -> dict[str, Tensor]:
    """What the optimiser remembers of each weight: ``weight/key``."""
    return {
        f"{name}/{key}": value
        for name, weight in model.named_parameters()
        for key, value in optimiser.state.get(weight, {}).items()
    }


def restore_optimiser(
    model: nn.Module, optimiser: torch.optim.Optimizer, tensors: Mapping[str, Tensor]
) -> None:
    """Put ``optimiser_state`` back; ``KeyError`` for a weight that the model does not have."""
    weights = dict(model.named_parameters())
    for full, value in tensors.items():
        name, key = full.rsplit("/", 1)
        optimiser.state[weights[name]][key] = value
