"""What the policies of an episode saw of the traffic, and who of them saw nothing."""

import numpy as np

from tsc_missing.network.model import BoolArray, Network
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.offline.plan import EpisodeSpec
from tsc_missing.seeding import stream
from tsc_missing.sensing.failures import draw_failure


def seen_by_policies(spec: EpisodeSpec, network: Network) -> BoolArray:
    """(T, N, 12): what reports to the policies of an episode."""
    steps = spec.run_settings().steps
    if spec.lost != "none":
        drawn = draw_failure(spec.lost, network, steps, stream(spec.seed, "lost"))
        if drawn is not None:
            return drawn
    return np.ones((steps, network.n, N_SLOTS), dtype=bool)


def unaware_set(share: float, seed: int, intersections: int) -> BoolArray:
    """(N,): which intersections of an episode are unaware, each with probability ``share``."""
    return np.asarray(stream(seed, "unaware").random(intersections) < share)


def saw_nothing(spec: EpisodeSpec, network: Network) -> BoolArray:
    """(N,): whose policy saw nothing of it: unaware ones, and those whose sensors never report."""
    unaware = unaware_set(spec.unaware, spec.seed, network.n)
    if spec.lost == "none":
        return unaware
    seen = seen_by_policies(spec, network) & network.slot_mask
    return np.asarray(unaware | ~seen.any(axis=(0, 2)))
