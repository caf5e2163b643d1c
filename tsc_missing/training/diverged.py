"""A training whose numbers are no numbers any more."""

from collections.abc import Iterable

import torch
from torch import Tensor


class DivergedError(RuntimeError):
    """The loss, the gradient or the weights are not finite."""


def check_finite(loss: Tensor, update: int) -> None:
    """Raise ``DivergedError`` where the loss of an update is not finite."""
    if not torch.isfinite(loss):
        raise DivergedError(
            f"at update {update} the loss is {loss.item()}; no weights were written"
        )


def check_weights(weights: Iterable[Tensor]) -> None:
    """Raise ``DivergedError`` where a weight is not finite."""
    if not all(torch.isfinite(tensor).all() for tensor in weights):
        raise DivergedError("the weights are not finite; none were written")
