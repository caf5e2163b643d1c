"""Conventional controllers under missing data, on the recorded flows.

    python -m tools.conventional --shared ../shared --out docs/results/conventional.md

Masks come from the seeds, the same for every method; ``att_all`` as mean and range over seeds.
"""

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

from tools.datasets import DATASETS
from tools.runs import HORIZON, import_dataset, run_all, seconds
from tsc_missing.config import MissingSettings, RunSettings
from tsc_missing.evaluation.metrics import Result
from tsc_missing.versions import versions

SEEDS = (0, 1, 2)
FULL = (
    "max-queue",
    "max-pressure",
    "advanced-max-pressure",
    "fixed-time",
    "fixed-time-30",
    "actuated",
    "delay_based",
)
METHODS = (  # controller, imputer, blind
    ("max-queue", "sfm-4", "fixed-time"),
    ("max-queue", "sfm", "fixed-time"),
    ("max-queue", "last", "fixed-time"),
    ("max-queue", "mean", "fixed-time"),
    ("max-queue", "sfm-4", "none"),
    ("max-pressure", "sfm-4", "fixed-time"),
    ("advanced-max-pressure", "sfm-4", "fixed-time"),
)
CASES = (("random", 0.5), ("kriging", 0.25))


def cells(net: str) -> dict[str, list[RunSettings]]:
    """The runs of a dataset by the name of their row's cell, one a seed where masks are drawn."""
    found = {
        f"none|{name}": [RunSettings(net=net, controller=name, missing=MissingSettings())]
        for name in FULL
    }
    for pattern, rate in CASES:
        missing = MissingSettings(pattern=pattern, rate=rate)
        for name, imputer, blind in METHODS:
            found[f"{pattern} {100 * rate:g} %|{name}, {imputer}, blind: {blind}"] = [
                RunSettings(
                    net=net,
                    controller=name,
                    imputer=imputer,
                    blind=blind,
                    missing=missing,
                    seed=seed,
                )
                for seed in SEEDS
            ]
    return found


def table(tables: dict[str, dict[str, list[Result]]]) -> list[str]:
    """Markdown: a row a case and method, a column a dataset."""
    names = list(tables)
    lines = [
        f"| missing | method | {' | '.join(names)} |",
        f"| --- | --- |{' ---: |' * len(names)}",
    ]
    for key in tables[names[0]]:
        case, method = key.split("|")
        values = [_cell([seconds(result) for result in tables[name][key]]) for name in names]
        lines.append(f"| {case} | {method} | {' | '.join(values)} |")
    return lines


def _cell(values: Sequence[float]) -> str:
    mean = sum(values) / len(values)
    spread = f" ({min(values):.1f}–{max(values):.1f})" if len(values) > 1 else ""
    return f"{mean:.1f}{spread}"


def main() -> None:
    """Run everything and print or write the table."""
    names = [dataset.name for dataset in DATASETS]
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--shared", type=Path, default=Path("../shared"))
    parser.add_argument("--out", type=Path)
    parser.add_argument("--datasets", nargs="+", choices=names, default=["jinan_1", "hangzhou_1"])
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        wanted = [d for d in DATASETS if d.name in options.datasets]
        runs = {d.name: cells(import_dataset(d, options.shared, Path(scratch))) for d in wanted}
        flat = [(d, key, s) for d, rows in runs.items() for key, all_ in rows.items() for s in all_]
        results = run_all([settings for _, _, settings in flat], options.workers)
    tables: dict[str, dict[str, list[Result]]] = {}
    for (dataset, key, _), result in zip(flat, results, strict=True):
        tables.setdefault(dataset, {}).setdefault(key, []).append(result)
    text = "\n".join([*_head(), *table(tables), ""])
    if options.out is None:
        print(text)
    else:
        options.out.write_text(text, encoding="utf-8")


def _head() -> list[str]:
    return [
        "# Conventional controllers under missing data",
        "",
        "Made by `python -m tools.conventional --shared ../shared --out "
        f"docs/results/conventional.md` with SUMO {versions()['libsumo']}: recorded flows, "
        f"{HORIZON} s, `att_all` in s; where data are missing the mean over seeds "
        f"{', '.join(map(str, SEEDS))} and the range. `fixed-time` and the cycle at blind "
        "intersections are timed for the very turning counts of the run, which flatters them; "
        "`actuated` and `delay_based` see everything and run inside SUMO.",
        "",
    ]


if __name__ == "__main__":
    main()
