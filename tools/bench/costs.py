"""Where the closed loop's time and memory go: stages of a run, and the imports."""

import json
import re
import statistics
import subprocess
import sys
from collections.abc import Callable, Iterable
from typing import Any

from tools.bench.case import Case, run_module
from tools.bench.processes import BenchError
from tools.bench.report import table

LOADED = "tsc_missing.cli.run"
IMPORT_LINE = re.compile(r"import time:\s+(\d+) \|\s+(\d+) \| ( *)(\S+)$")
SHOWN = 12  # of the packages that are imported


def bench_costs(case: Case, rounds: int, tell: Callable[[str], None]) -> dict[str, Any]:
    """Measure, print the tables, and return the values for JSON."""
    tell("stages of a run")
    runs = [_stages(case) for _ in range(rounds)]
    stages = [_median_stage(rows) for rows in zip(*runs, strict=True)]
    print(f"\nStages of one tsc-run ({case.controller}, {case.wanted.net}), in the order of their")
    print("first call; what a stage calls that is a stage itself counts for that one")
    rows = [
        [s["stage"], str(s["calls"]), f"{s['wall']:.3f}", f"{s['cpu']:.3f}", f"{s['memory']:+.1f}"]
        for s in stages
    ]
    print(table(["", "calls", "wall [s]", "CPU [s]", "peak memory [MB]"], rows))
    tell("imports")
    imports = _imports(rounds)
    print(f"\nImporting {LOADED}: packages by the time spent in their own modules")
    rows = [[name, f"{1000 * seconds:.1f}"] for name, seconds in imports.items()]
    print(table(["", "[ms]"], [*rows[:SHOWN], ["all", f"{1000 * sum(imports.values()):.1f}"]]))
    return {
        "controller": case.controller,
        "stages": stages,
        "imports": imports,
    }


def _stages(case: Case) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = json.loads(run_module("stages", *case.options))
    return rows


def _median_stage(rows: Iterable[dict[str, Any]]) -> dict[str, Any]:
    runs = list(rows)
    numbers = ("wall", "cpu", "memory")
    return {**runs[0], **{k: statistics.median(run[k] for run in runs) for k in numbers}}


def _imports(rounds: int) -> dict[str, float]:
    """Seconds by top-level package, largest first; the median of a few processes."""
    found = [_imports_once() for _ in range(rounds)]
    names = set().union(*found)
    seconds = {name: statistics.median(run.get(name, 0.0) for run in found) for name in names}
    return dict(sorted(seconds.items(), key=lambda item: -item[1]))


def _imports_once() -> dict[str, float]:
    command = [sys.executable, "-X", "importtime", "-c", f"import {LOADED}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise BenchError(done.stderr)
    seconds: dict[str, float] = {}
    for line in done.stderr.splitlines():
        match = IMPORT_LINE.match(line)
        if match:
            package = match[4].split(".")[0]
            seconds[package] = seconds.get(package, 0.0) + int(match[1]) / 1e6
    return seconds
