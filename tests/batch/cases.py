"""Suites for tests, batches that run meanwhile, and what processes they have."""

import subprocess
import time
from pathlib import Path

import pyarrow.parquet as pq

from tsc_missing.batch.folder import PLAN
from tsc_missing.evaluation.metrics import Result

PATIENCE = 300  # [s] for what takes seconds on a machine that is not busy
CLOCKS = {"wall_s", "sim_s_per_wall_s", "decision_ms_median", "decision_ms_p99"}

SUITE = """
title = "Small"
[methods.held]
controller = "max-queue"
imputer = "last"
[[runs]]
method = {methods}
net = "{net}"
missing = {{ pattern = "random", rate = 0.5 }}
horizon = {horizon}
seed = {seeds}
"""


def write_suite(
    command, net, methods='["max-queue", "held"]', horizon=90, seeds="[0, 1]", name="small"
):
    text = SUITE.format(net=net, methods=methods, horizon=horizon, seeds=seeds)
    (command.cwd / f"{name}.toml").write_text(text)


def rows(folder):
    """The table without what the clock says, by run."""
    table = pq.read_table(folder / "results.parquet").to_pylist()
    assert set(Result.model_fields) - {"demand"} <= set(table[0])
    return {row["run"]: {k: v for k, v in row.items() if k not in CLOCKS} for row in table}


def start(command, *arguments, **environment):
    """``tsc-batch`` in the background."""
    return command.start("batch", *arguments, **environment)


def wait_for(what, seconds=PATIENCE):
    """What ``what`` returns, once that is something."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        found = what()
        if found:
            return found
        time.sleep(0.02)
    raise AssertionError(f"waited {seconds} s in vain")


def finished(out: Path):
    """Names of the run folders that are there."""
    return sorted(path.name for path in (out / "runs").glob("[!.]*"))


def half_written(out: Path):
    """Names of the folders of the runs that are on their way."""
    return sorted(path.name for path in (out / "runs").glob(".*"))


def begun(out: Path):
    return (out / PLAN).exists() and bool(half_written(out))


def descendants(process: int):
    """The ids and command lines of all processes below one."""
    listing = subprocess.run(
        ["ps", "-A", "-ww", "-o", "pid=,ppid=,args="], capture_output=True, text=True, check=True
    )
    table = [line.split(None, 2) for line in listing.stdout.splitlines()]
    below, found = {str(process)}, {}
    for _ in table:
        new = {row[0]: row[2] for row in table if row[1] in below and row[0] not in below}
        if not new:
            break
        found.update({int(pid): words for pid, words in new.items()})
        below |= set(new)
    return found


def runners(process: int):
    """The processes below one that run simulations."""
    return [pid for pid, words in descendants(process).items() if "LokyProcess" in words]
