"""The two yardsticks of the networks: the conversion, and the bundled demand.

    python -m tools.yardsticks --shared ../shared --out docs/results/yardsticks.md

Yardstick 1 holds SUMO's ``att_all`` on the converted recorded flows against CityFlow's, for the
same controllers and protocol. Yardstick 2 holds the bundled demand against the recorded one,
both in SUMO. ``--vehicle tau=1.8`` (repeatable) tries another vehicle type, ``--datasets`` and
``--only`` do a part.
"""

import argparse
import json
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tools.datasets import DATASETS, REFERENCE
from tools.runs import HORIZON, import_dataset, run_all, seconds
from tsc_missing.config import RunSettings, SignalSettings, VehicleType
from tsc_missing.evaluation.metrics import Result
from tsc_missing.versions import versions

CONVERSION = ("fixed-time-15", "fixed-time-30", "max-pressure", "max-queue")
BUNDLED = ("fixed-time-15", "max-queue", "max-pressure")
SEEDS = (0, 1, 2)
SIGNALS = SignalSettings(max_red=0)  # as in CityFlow


@dataclass(frozen=True)
class Job:
    """One run of a dataset, recorded or bundled."""

    dataset: str
    settings: RunSettings

    @property
    def controller(self) -> str:
        """The controller's name."""
        return self.settings.controller


def conversion_table(jobs: Sequence[Job], results: Sequence[Result], shared: Path) -> list[str]:
    """Yardstick 1 as Markdown lines."""
    reference = {
        (row["dataset"], row["controller"]): row["att_all_s"]
        for row in json.loads((shared / REFERENCE).read_text())["rows"]
    }
    lines = [
        "| dataset | controller | CityFlow, s | SUMO, s | ratio | inserted | finished | gridlock |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: | --- |",
    ]
    deviations = []
    for job, result in zip(jobs, results, strict=True):
        expected = reference[job.dataset, job.controller]
        ratio = seconds(result) / expected
        if not job.dataset.startswith("newyork"):
            deviations.append(abs(ratio - 1))
        lines.append(
            f"| {job.dataset} | {job.controller} | {expected:.1f} | {seconds(result):.1f} | "
            f"{ratio:.3f} | {result.inserted} | {result.finished} | "
            f"{'yes' if result.gridlock else 'no'} |"
        )
    if deviations:
        lines += [
            "",
            f"Hangzhou and Jinan: median |ratio − 1| {100 * np.median(deviations):.1f} %, "
            f"worst {100 * max(deviations):.1f} % over {len(deviations)} rows.",
        ]
    return lines


def bundled_table(
    recorded: Sequence[Job],
    recorded_results: Sequence[Result],
    bundled: Sequence[Job],
    bundled_results: Sequence[Result],
) -> list[str]:
    """Yardstick 2 as Markdown lines."""
    lines = [
        "| dataset | controller | recorded, s | bundled, s (seeds "
        f"{', '.join(map(str, SEEDS))}) | mean ratio |",
        "| --- | --- | ---: | --- | ---: |",
    ]
    deviations = []
    for job, result in zip(recorded, recorded_results, strict=True):
        if job.controller not in BUNDLED:
            continue
        drawn = [
            seconds(r)
            for j, r in zip(bundled, bundled_results, strict=True)
            if (j.dataset, j.controller) == (job.dataset, job.controller)
        ]
        ratio = float(np.mean(drawn)) / seconds(result)
        deviations.append(abs(ratio - 1))
        values = ", ".join(f"{value:.1f}" for value in drawn)
        lines.append(
            f"| {job.dataset} | {job.controller} | {seconds(result):.1f} | {values} | {ratio:.3f} |"
        )
    return [*lines, "", f"Worst |mean ratio − 1|: {100 * max(deviations):.1f} %."]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what is asked for and print or write the tables."""
    options = _parse(arguments)
    vehicle = VehicleType.model_validate(dict(pair.split("=") for pair in options.vehicle))
    wanted = [d for d in DATASETS if d.name in options.datasets]
    with tempfile.TemporaryDirectory() as scratch:
        recorded, bundled = [], []
        for dataset in wanted:
            net = import_dataset(dataset, options.shared, Path(scratch))
            recorded += [
                Job(
                    dataset.name,
                    RunSettings(net=net, controller=c, vehicle=vehicle, signals=SIGNALS),
                )
                for c in CONVERSION
            ]
            bundled += [
                Job(
                    dataset.name,
                    RunSettings(net=dataset.name, controller=c, seed=s, signals=SIGNALS),
                )
                for c in BUNDLED
                for s in SEEDS
            ]
        if options.only == "conversion":
            bundled = []
        jobs = [*recorded, *bundled]
        results = run_all([job.settings for job in jobs], options.workers)
    first, second = results[: len(recorded)], results[len(recorded) :]
    text = _document(
        conversion_table(recorded, first, options.shared),
        bundled_table(recorded, first, bundled, second) if bundled else [],
        vehicle,
    )
    if options.out is None:
        print(text)
    else:
        options.out.write_text(text, encoding="utf-8")


def _document(conversion: list[str], bundled: list[str], vehicle: VehicleType) -> str:
    changed = vehicle.model_dump(exclude_defaults=True)
    head = [
        "# Yardsticks of the networks",
        "",
        "Made by `python -m tools.yardsticks --shared ../shared --out docs/results/yardsticks.md` "
        f"with SUMO {versions()['libsumo']}; one run a row, everything observed, "
        f"{HORIZON} s, vehicle type {changed or 'as in `config.py`'}.",
        "",
        "## 1. Conversion: recorded flows, CityFlow against SUMO (`att_all`)",
        "",
        *conversion,
    ]
    if bundled:
        head += [
            "",
            "## 2. Bundled against recorded demand, both in SUMO (`att_all`)",
            "",
            *bundled,
        ]
    return "\n".join([*head, ""])


def _parse(arguments: Iterable[str] | None) -> argparse.Namespace:
    names = [dataset.name for dataset in DATASETS]
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--shared", type=Path, default=Path("../shared"))
    parser.add_argument("--out", type=Path, help="the Markdown file to write")
    parser.add_argument("--only", choices=["conversion"], help="leave the bundled demand out")
    parser.add_argument("--datasets", nargs="+", choices=names, default=names)
    parser.add_argument("--vehicle", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--workers", type=int, default=2)
    return parser.parse_args(list(arguments) if arguments is not None else None)


if __name__ == "__main__":
    main()
