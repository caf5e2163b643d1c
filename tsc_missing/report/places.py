"""What became of each intersection, or of each movement, in a run: from ``movements.parquet``."""

import bisect
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import pyarrow as pa
import pyarrow.parquet as pq

from tsc_missing.errors import UserError
from tsc_missing.evaluation.run_folder import MOVEMENTS

Each = Literal["intersection", "movement"]
Row = dict[str, Any]  # of the file, by its columns

LEVELS = "ABCDEF"
LEVEL_ENDS = (10.0, 20.0, 35.0, 55.0, 80.0)  # [s] of delay up to which each but the last goes
NEEDED = (  # columns
    "intersection",
    "movement",
    "observed",
    "vehicles",
    "served",
    "total_time_loss",
    "total_depart_delay",
    "total_waiting_time",
    "mean_queue",
    "longest_queue",
    "longest_wait",
)


def level_of_service(delay: float | None) -> str | None:
    """The letter of the Highway Capacity Manual for a delay [s a vehicle] at a signal."""
    return None if delay is None else LEVELS[bisect.bisect_left(LEVEL_ENDS, delay)]


@dataclass(frozen=True)
class Place:
    """An intersection or a movement in a run; delays are in seconds a vehicle, None of nobody."""

    intersection: str
    movement: str | None  # None: the intersection with all of them
    observed: float  # share of readings
    vehicles: float
    served: float
    delay: float | None
    level_of_service: str | None
    time_loss: float | None
    depart_delay: float | None
    waiting_time: float | None
    mean_queue: float
    longest_queue: float  # of a movement
    longest_wait: float | None  # [s]

    @property
    def key(self) -> tuple[str, str | None]:
        """What it is called in every run."""
        return self.intersection, self.movement

    @property
    def name(self) -> str:
        """For people."""
        return " ".join(filter(None, self.key))

    def values(self) -> dict[str, object]:
        """All but what it is called."""
        named = asdict(self)
        return {key: named[key] for key in named if key not in ("intersection", "movement")}


def read_places(folder: Path, each: Each, field: str) -> tuple[Place, ...]:
    """The places of a run folder, in the order of its network; ``UserError`` where it has none."""
    rows = _read_rows(folder / MOVEMENTS, field)
    groups: dict[tuple[str, str | None], list[Row]] = {}
    for row in rows:
        movement = row["movement"] if each == "movement" else None
        groups.setdefault((row["intersection"], movement), []).append(row)
    return tuple(_place(*key, group) for key, group in groups.items())


def _read_rows(path: Path, field: str) -> list[Row]:
    if not path.is_file():
        words = f"it has no {path.name}: it was run before there was that file, so run it again"
        raise UserError(field, path.parent, words)
    try:
        with pq.ParquetFile(path) as file:  # not read_table, which imports pandas if it is there
            rows: list[Row] = file.read().select(NEEDED).to_pylist()
    except (OSError, KeyError, pa.ArrowException) as error:
        reason = str(error).partition("\n")[0]
        words = f"its {path.name} cannot be read, so run it again ({reason})"
        raise UserError(field, path.parent, words) from error
    holed = [name for name in NEEDED[:-1] if any(row[name] is None for row in rows)]
    if not rows or holed:
        words = f"no {holed[0]} in a row" if holed else "no row"
        raise UserError(field, path.parent, f"its {path.name} has {words}, so run it again")
    return rows


def _place(intersection: str, movement: str | None, rows: Sequence[Row]) -> Place:
    def total(name: str) -> float:
        return math.fsum(row[name] for row in rows)

    def most(name: str) -> float | None:
        return max((row[name] for row in rows if row[name] is not None), default=None)

    vehicles = total("vehicles")

    def each(*names: str) -> float | None:
        return math.fsum(map(total, names)) / vehicles if vehicles > 0 else None

    delay = each("total_time_loss", "total_depart_delay")
    return Place(
        intersection=intersection,
        movement=movement,
        observed=total("observed") / len(rows),
        vehicles=vehicles,
        served=total("served"),
        delay=delay,
        level_of_service=level_of_service(delay),
        time_loss=each("total_time_loss"),
        depart_delay=each("total_depart_delay"),
        waiting_time=each("total_waiting_time"),
        mean_queue=total("mean_queue"),
        longest_queue=most("longest_queue") or 0.0,
        longest_wait=most("longest_wait"),
    )
