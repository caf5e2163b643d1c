"""Episodes as what to learn from: features of what is seen or believed, and the returns."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from tsc_missing.lookahead.believed import Belief
from tsc_missing.lookahead.episode import Played
from tsc_missing.network.model import IntArray, Network
from tsc_missing.offline.log import red_steps_of
from tsc_missing.qlearning.features import (
    Float32Array,
    SlotTables,
    certainty_features,
    past_features,
    slot_features,
)


@dataclass(frozen=True)
class Labelled:
    """S decision steps of the N intersections of a network, and what their phases would lead to."""

    net: str
    features: tuple[Tensor, ...]  # (S, N, 12, ·) each: with everything observed, with each mask
    counted: tuple[Tensor, ...]  # (S, N) bool each: what may be learned from
    returns: Tensor  # (S, N, P), NaN without the phase


def labelled(
    played: Played,
    beliefs: Sequence[Belief],
    network: Network,
    interval: float,
    history: int,
    certainty: bool,
) -> Labelled:
    """An episode with features of its truth, and of what is believed with each of its masks.

    ``beliefs`` begin with that of the mask that it was played with, if it has holes. With others
    an intersection of which nothing is known is not learned from: what ran there gives away what
    the policy saw.
    """
    tables = SlotTables.of(network, interval)
    red_steps = red_steps_of(network, played.phase)
    truth = torch.from_numpy(played.values[_rows(played.steps, 1 + history)])
    seen = Belief(truth, torch.ones(truth.shape[:-1], dtype=torch.bool))

    def features(belief: Belief) -> Tensor:
        red = red_steps[_rows(played.steps, belief.values.shape[1])]
        parts = [_of_windows(tables, belief.values.numpy(), red, history)]
        if certainty:
            parts.append(certainty_features(belief.known.numpy().swapaxes(0, 1)))
        return torch.from_numpy(np.concatenate(parts, axis=-1))

    slots = torch.from_numpy(network.slot_mask)
    believed = (seen, *beliefs)
    real = 1 if played.mask.all() else 2  # of them are what the policy knew, or knew more
    counted = (
        (belief.known & slots).any(dim=3).any(dim=1) | (place < real)
        for place, belief in enumerate(believed)
    )
    return Labelled(played.net, tuple(map(features, believed)), tuple(counted), played.returns)


def _rows(steps: IntArray, count: int) -> IntArray:
    """(S, C): the last ``count`` C steps; before the first it was as in the first."""
    return np.asarray(np.maximum(steps[:, None] - np.arange(count - 1, -1, -1), 0))


def _of_windows(
    tables: SlotTables, values: Float32Array, red_steps: IntArray, history: int
) -> Float32Array:
    """(S, N, 12, ·) of the last of C steps: ``values`` (S, C, N, 12, F), ``red_steps`` to fit."""
    values, red_steps = values.swapaxes(0, 1), red_steps.swapaxes(0, 1)
    now = slot_features(tables, values[-1], red_steps[-1])
    return np.concatenate((now, past_features(values, red_steps, history)[-1]), axis=-1)
