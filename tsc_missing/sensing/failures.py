"""Failures drawn for episodes that something is learned from: a pattern at a rate of its own."""

from typing import Literal

import numpy as np

from tsc_missing.config import MissingSettings
from tsc_missing.errors import UserError
from tsc_missing.network.model import BoolArray, Network
from tsc_missing.sensing.patterns import draw_mask

Failure = Literal["random", "kriging", "lane", "burst", "mixed"]
MaybeFailure = Literal["none", "random", "kriging", "lane", "burst", "mixed"]

RATES: dict[Failure, tuple[float, float]] = {
    "random": (0.05, 0.9),
    "kriging": (0.1, 0.4),
    "lane": (0.05, 0.9),
    "burst": (0.05, 0.6),
    "mixed": (0.1, 0.6),
}
"""Of the patterns, drawn evenly from."""

TRIES = 20  # at a rate that a network allows


def draw_failure(
    pattern: Failure, network: Network, steps: int, random: np.random.Generator
) -> BoolArray | None:
    """(T, N, 12): what reports; None where the network has no room for it (kriging, if small)."""
    for _ in range(TRIES):
        missing = MissingSettings(pattern=pattern, rate=random.uniform(*RATES[pattern]))
        seed = int(random.integers(2**31))
        try:
            return draw_mask(missing, network, steps, seed)
        except UserError:
            continue
    return None
