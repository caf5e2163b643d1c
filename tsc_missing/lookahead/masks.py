"""What sensors lose in the episodes, and what else could have been lost in them."""

from collections.abc import Iterator

import numpy as np

from tsc_missing.config import MissingSettings
from tsc_missing.errors import UserError
from tsc_missing.lookahead.config import LookaheadSettings, Pattern
from tsc_missing.network.model import BoolArray, Network
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.seeding import stream
from tsc_missing.sensing.patterns import draw_mask

RATES = {
    "random": (0.05, 0.9),
    "kriging": (0.1, 0.4),
    "lane": (0.05, 0.9),
    "burst": (0.05, 0.6),
    "mixed": (0.1, 0.6),
}  # of the patterns, drawn evenly from
TRIES = 20  # at a rate that a network allows


def played_with(
    settings: LookaheadSettings, network: Network, steps: int, number: int
) -> BoolArray:
    """(T, N, 12): what reports in episode ``number``, by ``settings.lost`` in turn."""
    pattern = settings.lost[number % len(settings.lost)]
    everything = np.ones((steps, network.n, N_SLOTS), dtype=bool)
    if pattern == "none":
        return everything
    drawn = _drawn(pattern, network, steps, stream(settings.seed, f"lost-{number}"))
    return everything if drawn is None else drawn


def besides(
    settings: LookaheadSettings, network: Network, steps: int, number: int
) -> Iterator[BoolArray]:
    """(T, N, 12) each: other masks for episode ``number``, by ``settings.patterns``."""
    random = stream(settings.seed, f"masks-{number}")
    for pattern in settings.patterns:
        mask = _drawn(pattern, network, steps, random)
        if mask is not None:
            yield mask


def _drawn(
    pattern: Pattern, network: Network, steps: int, random: np.random.Generator
) -> BoolArray | None:
    """(T, N, 12), or None where the network has no room for the pattern (kriging, if small)."""
    for _ in range(TRIES):
        missing = MissingSettings(pattern=pattern, rate=random.uniform(*RATES[pattern]))
        seed = int(random.integers(2**31))
        try:
            return draw_mask(missing, network, steps, seed)
        except UserError:
            continue
    return None
