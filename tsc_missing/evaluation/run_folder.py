"""The run folder: run.json, decisions.parquet, trips.parquet, movements.parquet, mask.npz."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from tsc_missing.evaluation import columns
from tsc_missing.evaluation.movements import Movements
from tsc_missing.evaluation.steps import Scene, Trace
from tsc_missing.network.model import FloatArray
from tsc_missing.network.slots import N_SLOTS, slot_name
from tsc_missing.sensing.masks import save_mask
from tsc_missing.sensing.observation import QUEUE, VEHICLES
from tsc_missing.simulation.outputs import TripTimes

RUN = "run.json"
DECISIONS = "decisions.parquet"
TRIPS = "trips.parquet"
MOVEMENTS = "movements.parquet"
MASK = "mask.npz"
SLOT_NAMES = tuple(map(slot_name, range(N_SLOTS)))
STATUS = ("waiting", "running", "finished")


def is_whole(folder: Path) -> bool:
    """Whether there is a run in a folder."""
    return (folder / RUN).is_file()


def write_run(folder: Path, run: dict[str, Any]) -> None:
    """Write ``run.json``."""
    (folder / RUN).write_text(json.dumps(run, indent=1) + "\n", encoding="utf-8")


def write_mask(folder: Path, scene: Scene) -> None:
    """Write the mask, from which the run can be replayed."""
    save_mask(folder / MASK, scene.mask, scene.network.ids)


def write_trips(folder: Path, scene: Scene, trips: TripTimes, horizon: float) -> None:
    """Write a row a vehicle, in the order of the demand; times in s, null where not reached.

    ``id`` is what the demand's source calls it, or else its number.
    """
    status = np.where(trips.finished, 2, np.where(trips.inserted, 1, 0)).astype(np.int8)
    table = columns.table(
        {
            "vehicle": columns.numbers(np.arange(len(trips.scheduled), dtype=np.int32)),
            "id": columns.texts([trip.name or str(k) for k, trip in enumerate(scene.demand.trips)]),
            "type": columns.names(trip.type for trip in scene.demand.trips),
            "origin": columns.names(trip.route[0] for trip in scene.demand.trips),
            "destination": columns.names(trip.route[-1] for trip in scene.demand.trips),
            "status": columns.coded(status, STATUS),
            "scheduled": columns.numbers(trips.scheduled),
            "depart": columns.measured(trips.depart),
            "arrival": columns.measured(trips.arrival),
            "travel_time": columns.numbers(trips.travel_time(horizon)),
            "depart_delay": columns.numbers(trips.depart_delay(horizon)),
            "time_loss": columns.measured(trips.time_loss),
            "waiting_time": columns.measured(trips.waiting_time),
            "route_length": columns.measured(trips.route_length),
        }
    )
    pq.write_table(table, folder / TRIPS)


def write_movements(folder: Path, scene: Scene, movements: Movements) -> None:
    """Write a row a slot that is there, in the order of the intersections; null where NaN."""
    network = scene.network
    n, slots = np.nonzero(network.slot_mask)
    found = {
        "intersection": columns.coded(n.astype(np.int32), network.ids),
        "movement": columns.coded(slots.astype(np.int32), SLOT_NAMES),
        **{name: columns.measured(it[n, slots]) for name, it in movements.columns().items()},
    }
    pq.write_table(columns.table(found), folder / MOVEMENTS)


def write_decisions(folder: Path, scene: Scene, trace: Trace) -> None:
    """Write a row a step and intersection.

    ``phase`` is what ran in the step; ``observed``, ``vehicles``, ``queue`` and the ``estimated_``
    columns are lists over the 12 slots: which of them reported, the truth at the step's start,
    and what the controller took it for (null where it filled nothing). The ``planned_`` columns,
    of controllers that plan, hold such a list for each of the H steps ahead.
    """
    steps, n = trace.phase.shape
    found = {
        "step": columns.numbers(np.repeat(np.arange(steps, dtype=np.int32), n)),
        "time": columns.numbers(np.repeat(trace.time, n)),
        "intersection": columns.coded(
            np.tile(np.arange(n, dtype=np.int32), steps), scene.network.ids
        ),
        "phase": columns.numbers(trace.phase.astype(np.int8)),
        "observed": columns.lists(columns.flags(trace.mask), N_SLOTS),
        "vehicles": _counts(trace.truth[..., VEHICLES]),
        "queue": _counts(trace.truth[..., QUEUE]),
        "estimated_vehicles": _counts(trace.estimate[..., VEHICLES]),
        "estimated_queue": _counts(trace.estimate[..., QUEUE]),
    }
    if trace.planned is not None:
        found["planned_vehicles"] = _ahead(trace.planned[..., VEHICLES])
        found["planned_queue"] = _ahead(trace.planned[..., QUEUE])
    pq.write_table(columns.table(found), folder / DECISIONS)


def _counts(values: FloatArray) -> columns.Array:
    """Lists over the 12 slots; null where NaN."""
    return columns.lists(columns.measured(values.astype(np.float32)), N_SLOTS)


def _ahead(values: FloatArray) -> columns.Array:
    """Lists over the H steps ahead of lists over the slots, from (T, N, H, 12)."""
    return columns.lists(_counts(values), values.shape[2])
