"""The run folder: run.json, decisions.parquet, trips.parquet, mask.npz."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tsc_missing.evaluation.closed_loop import Scene, Trace
from tsc_missing.network.model import BoolArray, FloatArray
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.sensing.masks import save_mask
from tsc_missing.sensing.observation import QUEUE, VEHICLES
from tsc_missing.simulation.outputs import TripTimes

RUN = "run.json"
DECISIONS = "decisions.parquet"
TRIPS = "trips.parquet"
MASK = "mask.npz"


def write_run(folder: Path, run: dict[str, Any]) -> None:
    """Write ``run.json``."""
    (folder / RUN).write_text(json.dumps(run, indent=1) + "\n", encoding="utf-8")


def write_mask(folder: Path, scene: Scene) -> None:
    """Write the mask, from which the run can be replayed."""
    save_mask(folder / MASK, scene.mask, scene.network.ids)


def write_trips(folder: Path, scene: Scene, trips: TripTimes, horizon: float) -> None:
    """Write a row a vehicle, in the order of the demand; times in s, null where not reached."""
    status = np.where(trips.finished, 2, np.where(trips.inserted, 1, 0))
    names = pa.array(["waiting", "running", "finished"])
    table = pa.table(
        {
            "vehicle": pa.array(np.arange(len(trips.scheduled), dtype=np.int32)),
            "origin": pa.array([t.route[0] for t in scene.demand.trips]).dictionary_encode(),
            "destination": pa.array([t.route[-1] for t in scene.demand.trips]).dictionary_encode(),
            "status": pa.DictionaryArray.from_arrays(pa.array(status.astype(np.int8)), names),
            "scheduled": pa.array(trips.scheduled),
            "depart": _nullable(trips.depart),
            "arrival": _nullable(trips.arrival),
            "travel_time": pa.array(trips.travel_time(horizon)),
            "depart_delay": pa.array(trips.depart_delay(horizon)),
            "time_loss": _nullable(trips.time_loss),
            "waiting_time": _nullable(trips.waiting_time),
            "route_length": _nullable(trips.route_length),
        }
    )
    pq.write_table(table, folder / TRIPS)


def write_decisions(folder: Path, scene: Scene, trace: Trace) -> None:
    """Write a row a step and intersection.

    ``phase`` is what ran in the step; ``observed``, ``vehicles``, ``queue`` and the ``estimated_``
    columns are lists over the 12 slots: which of them reported, the truth at the step's start,
    and what the controller took it for (null where it filled nothing). The ``planned_`` columns,
    of controllers that plan, hold such a list for each of the H steps ahead.
    """
    steps, n = trace.phase.shape
    intersections = pa.DictionaryArray.from_arrays(
        pa.array(np.tile(np.arange(n, dtype=np.int32), steps)), pa.array(scene.network.ids)
    )
    columns = {
        "step": pa.array(np.repeat(np.arange(steps, dtype=np.int32), n)),
        "time": pa.array(np.repeat(trace.time, n)),
        "intersection": intersections,
        "phase": pa.array(trace.phase.ravel().astype(np.int8)),
        "observed": _lists(pa.array(trace.mask.ravel())),
        "vehicles": _counts(trace.truth[..., VEHICLES]),
        "queue": _counts(trace.truth[..., QUEUE]),
        "estimated_vehicles": _counts(trace.estimate[..., VEHICLES]),
        "estimated_queue": _counts(trace.estimate[..., QUEUE]),
    }
    if trace.planned is not None:
        columns["planned_vehicles"] = _ahead(trace.planned[..., VEHICLES])
        columns["planned_queue"] = _ahead(trace.planned[..., QUEUE])
    pq.write_table(pa.table(columns), folder / DECISIONS)


def _nullable(values: FloatArray) -> Any:
    missing: BoolArray = np.isnan(values)
    return pa.array(values, mask=missing)


def _counts(values: FloatArray) -> Any:
    flat = values.ravel().astype(np.float32)
    return _lists(pa.array(flat, mask=np.isnan(flat)))


def _ahead(values: FloatArray) -> Any:
    """Lists over the H steps ahead of lists over the slots, from (T, N, H, 12)."""
    return pa.FixedSizeListArray.from_arrays(_counts(values), values.shape[2])


def _lists(values: Any) -> Any:
    return pa.FixedSizeListArray.from_arrays(values, N_SLOTS)
