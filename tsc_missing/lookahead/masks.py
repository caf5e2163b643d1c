"""What sensors lose in the episodes, and what else could have been lost in them."""

from collections.abc import Iterator

import numpy as np

from tsc_missing.lookahead.config import LookaheadSettings
from tsc_missing.network.model import BoolArray, Network
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.seeding import stream
from tsc_missing.sensing.failures import draw_failure


def played_with(
    settings: LookaheadSettings, network: Network, steps: int, number: int
) -> BoolArray:
    """(T, N, 12): what reports in episode ``number``, by ``settings.lost`` in turn."""
    pattern = settings.lost[number % len(settings.lost)]
    everything = np.ones((steps, network.n, N_SLOTS), dtype=bool)
    if pattern == "none":
        return everything
    drawn = draw_failure(pattern, network, steps, stream(settings.seed, f"lost-{number}"))
    return everything if drawn is None else drawn


def besides(
    settings: LookaheadSettings, network: Network, steps: int, number: int
) -> Iterator[BoolArray]:
    """(T, N, 12) each: other masks for episode ``number``, by ``settings.patterns``."""
    random = stream(settings.seed, f"masks-{number}")
    for pattern in settings.patterns:
        mask = draw_failure(pattern, network, steps, random)
        if mask is not None:
            yield mask
