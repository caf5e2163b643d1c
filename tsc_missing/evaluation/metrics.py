"""The result fields of a run (``docs/metrics.md``), from SUMO's outputs and the loop's trace."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from tsc_missing.evaluation.steps import Scene, Trace
from tsc_missing.network.model import FloatArray
from tsc_missing.sensing.masks import missing_share
from tsc_missing.sensing.observation import QUEUE, VEHICLES
from tsc_missing.simulation.outputs import (
    LaneTotals,
    OutputFiles,
    Totals,
    TripTimes,
    read_lanes,
    read_totals,
    read_trips,
)

GRIDLOCK_WINDOW = 600.0  # [s]
GRIDLOCK_SHARE = 0.1

Seconds = Annotated[float | None, Field(description="s")]


class Result(BaseModel):
    """What a run comes to; ``None`` where there is nothing to average."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    att_all: Seconds
    att_approach: Seconds
    att_finished: Seconds
    p95_travel_time: Seconds
    demand: int
    inserted: int
    finished: int
    never_inserted: int
    mean_queue: float  # vehicles in the network below 0.1 m/s on entrance lanes, mean over steps
    time_loss: Seconds
    depart_delay: Seconds
    stops: float | None = None  # a vehicle; results of versions before have none
    teleports: int
    collisions: int
    emergency_brakings: int
    gridlock: bool
    missing_share: float  # of slots and steps
    imputation_mae: float | None  # vehicles, over masked cells
    decision_ms_median: float | None
    decision_ms_p99: float | None
    fallbacks: int  # intersection-steps that the safe fallback answered
    held_greens: int  # intersection-steps in which the minimum green overruled the controller
    wall_s: float
    sim_s_per_wall_s: float


@dataclass(frozen=True)
class Measured:
    """What SUMO measured in a run."""

    trips: TripTimes
    lanes: LaneTotals  # of the network's ``sensor_lanes``
    totals: Totals


def read_outputs(scene: Scene, files: OutputFiles) -> Measured:
    """Each of SUMO's outputs, read once."""
    scheduled = np.array([trip.depart for trip in scene.demand.trips], dtype=float)
    return Measured(
        trips=read_trips(files.trips, scheduled, scene.begin),
        lanes=read_lanes(files.lanes, scene.network.sensor_lanes),
        totals=read_totals(files.statistics),
    )


def summarise(
    scene: Scene, trace: Trace, measured: Measured, horizon: float, fallbacks: int
) -> Result:
    """The result of a finished run."""
    on_approach = float(measured.lanes.seconds.sum())
    fields: dict[str, object] = {
        **_travel_times(measured.trips, on_approach, horizon),
        **_counts(measured.trips, measured.totals, horizon),
        **_decision_times(trace),
        "mean_queue": float(trace.truth[:, :, :, QUEUE].sum(axis=(1, 2)).mean()),
        "missing_share": missing_share(trace.mask, scene.network.slot_mask),
        "imputation_mae": imputation_error(scene, trace, trace.estimate),
        "fallbacks": fallbacks,
        "held_greens": trace.held,
        "wall_s": trace.wall_seconds,
        "sim_s_per_wall_s": horizon / trace.wall_seconds,
    }
    return Result.model_validate(fields)


def percentile(values: FloatArray, percent: float) -> float:
    """``np.percentile`` of at least one number, which would load NumPy's masked arrays (13 ms)."""
    place = percent / 100.0 * (values.size - 1)
    return float(np.interp(place, np.arange(values.size), np.sort(values)))


def _mean(values: FloatArray) -> float | None:
    return float(values.mean()) if values.size else None


def _travel_times(trips: TripTimes, on_approach: float, horizon: float) -> dict[str, float | None]:
    travel = trips.travel_time(horizon)
    inserted, finished = trips.inserted, trips.finished
    return {
        "att_all": _mean(travel),
        "att_approach": on_approach / float(inserted.sum()) if inserted.any() else None,
        "att_finished": _mean((trips.arrival - trips.depart)[finished]),
        "p95_travel_time": percentile(travel, 95) if travel.size else None,
        "time_loss": _mean(trips.time_loss[inserted]),
        "depart_delay": _mean(trips.depart_delay(horizon)),
        "stops": _mean(trips.stops[inserted]),
    }


def _counts(trips: TripTimes, totals: Totals, horizon: float) -> dict[str, int]:
    inserted, finished = int(trips.inserted.sum()), int(trips.finished.sum())
    return {
        "demand": len(trips.scheduled),
        "inserted": inserted,
        "finished": finished,
        "never_inserted": len(trips.scheduled) - inserted,
        "teleports": totals.teleports,
        "collisions": totals.collisions,
        "emergency_brakings": totals.emergency_brakings,
        "gridlock": gridlocked(trips, horizon),
    }


def gridlocked(trips: TripTimes, horizon: float) -> bool:
    """Whether the network had stopped at the horizon.

    It had when, in its last ten minutes, fewer vehicles arrived than a tenth of those that were
    in the network when the ten minutes began.
    """
    begin = horizon - GRIDLOCK_WINDOW
    there = (trips.depart < begin) & ~(trips.arrival < begin)
    arrived = (trips.arrival >= begin).sum()
    return bool(begin > 0 and arrived < GRIDLOCK_SHARE * there.sum())


def imputation_error(scene: Scene, trace: Trace, estimate: FloatArray) -> float | None:
    """Mean absolute error of the vehicles [vehicles] in masked cells that were filled."""
    cells = ~trace.mask & scene.network.slot_mask & np.isfinite(estimate[..., VEHICLES])
    error = np.abs(estimate[..., VEHICLES] - trace.truth[..., VEHICLES])[cells]
    return _mean(error)


def _decision_times(trace: Trace) -> dict[str, float | None]:
    taken = 1000.0 * trace.decision_seconds[np.isfinite(trace.decision_seconds)]
    if not taken.size:
        return {"decision_ms_median": None, "decision_ms_p99": None}
    return {"decision_ms_median": percentile(taken, 50), "decision_ms_p99": percentile(taken, 99)}
