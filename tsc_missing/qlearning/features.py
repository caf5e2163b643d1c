"""What a Q-network sees of a slot: the one place of its features and their scales."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tsc_missing.controllers.advanced_max_pressure import share_in_reach
from tsc_missing.network.model import BoolArray, FloatArray, IntArray, Network
from tsc_missing.sensing.observation import QUEUE, VEHICLES

Float32Array = npt.NDArray[np.float32]

VEHICLE_SCALE = 10.0  # [vehicles] that count as 1
RED_SCALE = 20  # [decision steps] without green that count as 1, the most

OWN = ("there", "green", "queue", "running", "effective_running", "red_steps", "lanes")
BESIDE = ("downstream_queue", "downstream_running", "pressure")
UPSTREAM = ("queue", "running", "green", "there")  # of each of the three neighbour slots
PAST = ("queue", "running", "green")  # of each of the decision steps before
CERTAINTY = ("known", "silence")  # of what may have been filled in
NAMES = (*OWN, *BESIDE, *(f"upstream_{name}_{k}" for name in UPSTREAM for k in range(3)))
N_NAMES = len(NAMES)
MOST_HISTORY = 8  # decision steps before the present


def names_with(history: int, certainty: bool = False) -> tuple[str, ...]:
    """All features of a network that looks ``history`` decision steps back.

    With ``certainty`` it is also told what was seen and what was filled in.
    """
    past = (f"{name}_{k}_ago" for k in range(1, history + 1) for name in PAST)
    return (*NAMES, *past, *(CERTAINTY if certainty else ()))


def columns(names: Sequence[str], among: Sequence[str] = NAMES) -> list[int]:
    """The positions of features ``among`` all."""
    return sorted(among.index(name) for name in names)


@dataclass(frozen=True)
class SlotTables:
    """What the features need of a network."""

    there: BoolArray  # (N, 12)
    lanes: IntArray  # (N, 12)
    in_reach: FloatArray  # (N, 12)
    upstream: IntArray  # (N, 12, 3) flat slots, -1 for none
    downstream: IntArray  # (N, 12, D) flat slots, -1 for none
    exit_lanes: IntArray  # (N, 12)

    @classmethod
    def of(
        cls, network: Network, interval: float, detector_length: float | None = None
    ) -> "SlotTables":
        """``interval`` [s] between decisions; sensors cover ``detector_length`` [m], None all."""
        return cls(
            there=network.slot_mask,
            lanes=network.slot_lane_count,
            in_reach=share_in_reach(network, interval, detector_length),
            upstream=network.neighbours,
            downstream=network.downstream,
            exit_lanes=network.exit_lane_count,
        )


def slot_features(
    tables: SlotTables, values: npt.NDArray[np.floating[Any]], red_steps: IntArray
) -> Float32Array:
    """(…, N, 12, N_NAMES) of values (…, N, 12, F) [vehicles] and ``red_steps`` (…, N, 12).

    ``pressure`` is the efficient pressure: mean queue a lane here minus that of the exit lanes.
    """
    queue = values[..., QUEUE]
    running = np.maximum(values[..., VEHICLES] - queue, 0.0)
    green = (red_steps == 0).astype(float)
    lanes = np.maximum(tables.lanes, 1)
    exits = np.maximum(tables.exit_lanes, 1)
    down_queue = _flat(queue, tables.downstream).sum(axis=-1) / exits
    down_running = _flat(running, tables.downstream).sum(axis=-1) / exits
    there = np.broadcast_to(tables.there, queue.shape).astype(float)
    single = (
        there,
        green,
        queue / VEHICLE_SCALE,
        running / VEHICLE_SCALE,
        running * tables.in_reach / VEHICLE_SCALE,
        np.minimum(red_steps, RED_SCALE) / RED_SCALE,
        np.broadcast_to(tables.lanes, queue.shape) / 2.0,
        down_queue / VEHICLE_SCALE,
        down_running / VEHICLE_SCALE,
        (queue / lanes - down_queue) / VEHICLE_SCALE,
    )
    above = [
        _flat(queue, tables.upstream) / VEHICLE_SCALE,
        _flat(running, tables.upstream) / VEHICLE_SCALE,
        _flat(green, tables.upstream),
        _flat(there, tables.upstream),
    ]
    return np.concatenate((np.stack(single, axis=-1), *above), axis=-1).astype(np.float32)


def past_features(
    values: npt.NDArray[np.floating[Any]], red_steps: IntArray, history: int
) -> Float32Array:
    """(T, …, N, 12, 3 * history): what a slot was in the steps before each of T steps.

    ``values`` (T, …, N, 12, F) [vehicles], ``red_steps`` (T, …, N, 12); before the first step it
    was as in the first.
    """
    queue = values[..., QUEUE]
    running = np.maximum(values[..., VEHICLES] - queue, 0.0)
    now = np.stack((queue / VEHICLE_SCALE, running / VEHICLE_SCALE, red_steps == 0), axis=-1)
    before = [np.maximum(np.arange(len(values)) - k, 0) for k in range(1, history + 1)]
    found = np.concatenate([now[..., :0], *(now[rows] for rows in before)], axis=-1)
    return found.astype(np.float32)


def certainty_features(known: BoolArray) -> Float32Array:
    """(…, N, 12, 2) of the last of C steps, of which ``known`` (C, …, N, 12) are those seen.

    Whether a slot was seen now, and for how many steps it was not, C counting as 1.
    """
    newest_first = known[::-1]
    silence = np.where(known.any(axis=0), newest_first.argmax(axis=0), len(known)) / len(known)
    return np.stack((newest_first[0], silence), axis=-1).astype(np.float32)


def log_features(
    tables: SlotTables, values: Float32Array, red_steps: IntArray, history: int
) -> Float32Array:
    """(T, N, 12, N_NAMES + 3 * history) of T steps that follow each other; arguments as above."""
    past = past_features(values, red_steps, history)
    return np.concatenate((slot_features(tables, values, red_steps), past), axis=-1)


def _flat(x: npt.NDArray[np.floating[Any]], table: IntArray) -> npt.NDArray[np.floating[Any]]:
    """(…, N, 12, D): ``x`` (…, N, 12) at the flat slots of the table, 0 where there is none."""
    flat = x.reshape(*x.shape[:-2], x.shape[-2] * x.shape[-1])
    found = flat[..., np.maximum(table, 0)]
    return np.where(table >= 0, found, 0.0)
