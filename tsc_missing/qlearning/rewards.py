"""What the steps of an episode were worth."""

from typing import Any

import numpy as np
import numpy.typing as npt

from tsc_missing.network.model import Network
from tsc_missing.offline.log import EpisodeLog
from tsc_missing.qlearning.config import QLearningSettings
from tsc_missing.sensing.observation import QUEUE, VEHICLES

Float32Array = npt.NDArray[np.float32]


def rewards(log: EpisodeLog, network: Network, settings: QLearningSettings) -> Float32Array:
    """(T - 1, N): the scaled reward of each step but the last, whose end is not in the log."""
    if settings.reward == "departures":
        found = departures(log, network)
    else:
        found = queue_reward(log.values[1:], settings.running_weight)
    return np.asarray(found / settings.reward_scale, dtype=np.float32)


def queue_reward(
    values: npt.NDArray[np.floating[Any]], running_weight: float = 0.0
) -> npt.NDArray[np.floating[Any]]:
    """(…, N) [vehicles]: minus the vehicles on the entrance lanes, from values (…, N, 12, F).

    Those that run count with ``running_weight``, those that queue in full.
    """
    total = values.sum(axis=-2)
    queue = total[..., QUEUE]
    return np.asarray(-(queue + running_weight * (total[..., VEHICLES] - queue)))


def departures(log: EpisodeLog, network: Network) -> Float32Array:
    """(T - 1, N): vehicles that the greens of a step let through, as far as counts tell.

    Discounted, it asks for the same as minus the vehicles on the entrance lanes, because these are
    those that arrived less those that left; but arrivals, which no signal decides, are most of
    the noise in their number, and are left out here. A green slot lost what it had, less what it
    has now, plus what arrived meanwhile; for the last its mean while it was red stands in.
    Slots that are green in every phase are not counted.
    """
    vehicles = log.values[..., VEHICLES]
    growth = np.diff(vehicles, axis=0)  # (T - 1, N, 12)
    green = (log.red_steps[1:] == 0) & ~network.free_slots
    red = (log.red_steps[1:] > 0) & network.slot_mask
    arrivals = (growth * red).sum(axis=0) / np.maximum(red.sum(axis=0), 1)
    return np.asarray(((arrivals - growth) * green).sum(axis=2), dtype=np.float32)
