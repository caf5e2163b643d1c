"""What became of the vehicles of a simulation, from its trip output, for comparisons."""

import hashlib
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tools.bench.case import CASE
from tsc_missing.simulation.outputs import read_trips


def traffic(trips_file: Path, scheduled: Sequence[float], horizon: float) -> dict[str, object]:
    """Counts, sums of times [s], and a digest over every trip's times."""
    trips = read_trips(trips_file, np.array(scheduled))
    columns = (trips.depart, trips.arrival, trips.time_loss, trips.waiting_time)
    travel = trips.travel_time(horizon)
    return {
        "demand": len(scheduled),
        "inserted": int(trips.inserted.sum()),
        "finished": int(trips.finished.sum()),
        "travel_time": float(travel.sum()),
        "att_all": float(travel.mean()),
        "digest": hashlib.sha256(np.stack(columns).tobytes()).hexdigest()[:16],
    }


def main(case_folder: str, trips_file: str, horizon: str) -> None:
    """Print the traffic of a trip output as JSON; the demand is the case's."""
    case = json.loads(Path(case_folder, CASE).read_text(encoding="utf-8"))
    print(json.dumps(traffic(Path(trips_file), case["scheduled"], float(horizon))))


if __name__ == "__main__":
    main(*sys.argv[1:])
