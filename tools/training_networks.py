"""Generated networks to train on besides the bundled ones: small, and unlike them.

    python -m tools.training_networks --out data/networks --count 16

Each is one `tsc-net generate` with options drawn from its number: rows, columns, lengths, lanes
shared or not, missing roads, demand from light to heavy. What is there is not made again.
"""

import argparse
import subprocess
import sys
from pathlib import Path

import numpy as np

from tsc_missing.network.folder import MANIFEST
from tsc_missing.seeding import stream

LANES = ("1", "2", "3", "4", "l,s,s,sr", "ls,s,r")
SIDE_LANES = ("1", "2", "3")
COURSES = ("constant", "peak", "ramp", "gaussian")
TURNS = ("0.1,0.6,0.3", "0.2,0.6,0.2", "0.3,0.4,0.3", "0.05,0.85,0.1")
PER_LANE = (40.0, 260.0)  # [vehicles/h] that enter on a lane, from light to heavy


def options(number: int) -> list[str]:
    """The words of network ``number`` after ``tsc-net generate``."""
    rng = stream(number, "training-network")
    rows, columns = (int(rng.integers(1, 4)) for _ in range(2))
    columns = max(columns, 2)
    lanes, arterial = str(rng.choice(LANES)), bool(rng.random() < 0.4)
    side = str(rng.choice(SIDE_LANES)) if arterial else lanes
    entering = 2 * (rows * _count(lanes) + columns * _count(side))
    chosen = {
        "rows": rows,
        "columns": columns,
        "east-west": _length(rng),
        "north-south": _length(rng),
        "lanes": lanes,
        **({"side-lanes": side} if arterial else {}),
        "speed": float(rng.choice([8.33, 11.11, 13.89])),
        "remove-share": float(rng.choice([0.0, 0.0, 0.15, 0.3])) if rows > 1 else 0.0,
        "vehicles-per-hour": round(entering * float(rng.uniform(*PER_LANE))),
        "course": str(rng.choice(COURSES)),
        "turns": str(rng.choice(TURNS)),
        "through": float(rng.choice([0.0, 0.3])),
        "seed": number,
    }
    return [word for name, value in chosen.items() for word in (f"--{name}", str(value))]


def _length(rng: np.random.Generator) -> int:
    """Metres, most of them short."""
    return 10 * round(float(np.exp(rng.uniform(np.log(12), np.log(70)))))


def _count(lanes: str) -> int:
    return int(lanes) if lanes.isdigit() else lanes.count(",") + 1


def main() -> None:
    """Make what is not there."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="the folder of the networks")
    parser.add_argument("--count", type=int, default=16)
    wanted = parser.parse_args()
    wanted.out.mkdir(parents=True, exist_ok=True)
    for number in range(wanted.count):
        target = wanted.out / f"generated-{number:02}"
        if not (target / MANIFEST).is_file():
            words = ["generate", *options(number), "--out", str(target)]
            subprocess.run([sys.executable, "-m", "tsc_missing.cli.net", *words], check=True)


if __name__ == "__main__":
    main()
