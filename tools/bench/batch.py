"""tsc-batch: two workers against one, both against the bare runs, and a worker's memory.

The bare runs are also made two at a time: what the machine gives two simulations at once is as much
as any batch can reach.
"""

import shlex
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tools.bench.case import Case
from tools.bench.processes import BenchError, Program, alternate, ratio
from tools.bench.report import Target, cost_table, show, values, verdict

RUNS = 8  # of a timed batch
ONE, TWO = "one worker", "two workers"
BARE, BARE_TWO = "bare runs", "bare runs, two at a time"
OVERHEAD = Target(ONE, BARE, "wall", 1.05)
SPEED_UP = 1.85  # at least, of two workers over one
MEMORY_RUNS = 50
MEMORY_HORIZON = 300  # [s] of each of them
EARLY = 10  # the run from which on a worker's memory should stay as it is
GROWTH = 1.02  # at most, of its memory from then to its last run
POLL = 0.05  # [s]


def bench_batch(case: Case, rounds: int, tell: Callable[[str], None]) -> dict[str, Any]:
    """Measure, print the tables, and return the values for JSON."""
    suite = _suite(case, "timed", RUNS, case.wanted.horizon)
    programs = [_batch(ONE, suite, 1), _bare(BARE, case, 1)]
    programs += [_batch(TWO, suite, 2), _bare(BARE_TWO, case, 2)]
    costs = alternate(programs, rounds, tell)
    print(f"\n{RUNS} runs of {case.controller}, {case.wanted.net}, {case.wanted.horizon} s each")
    print(cost_table(costs, BARE))
    print(verdict(OVERHEAD, costs))
    faster = ratio(costs[ONE], costs[TWO], "wall")
    met = "met" if faster.median >= SPEED_UP else "MISSED"
    print(f"two workers are {show(faster, 2)} times as fast, target at least {SPEED_UP}: {met}")
    floor = ratio(costs[BARE], costs[BARE_TWO], "wall")
    print(f"the bare runs are {show(floor, 2)} times as fast two at a time")
    tell("memory of a worker")
    memory = worker_memory(_suite(case, "memory", MEMORY_RUNS, MEMORY_HORIZON), case.folder)
    first, last = min(run for run in memory if run >= EARLY), max(memory)
    growth = memory[last] / memory[first]
    met = "met" if growth <= GROWTH else "MISSED"
    shown = [run for run in memory if run in (1, first, MEMORY_RUNS // 2, last)]
    print(
        f"memory of one worker in runs {', '.join(map(str, shown))}: "
        f"{', '.join(f'{memory[run]:.0f}' for run in shown)} MB; from run {first} on "
        f"× {growth:.3f}, target at most {GROWTH}: {met}"
    )
    return {"controller": case.controller, "memory": memory, **values(costs, BARE)}


def _suite(case: Case, name: str, runs: int, horizon: int) -> Path:
    path = case.folder / f"{name}.toml"
    wanted = case.wanted
    lines = (
        "[[runs]]",
        f'method = "{case.controller}"',
        f'net = "{wanted.net}"',
        f'demand = "{wanted.demand}"',
        f"horizon = {horizon}",
        f"seed = {[wanted.seed + k for k in range(runs)]}",
    )
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _command(suite: Path, workers: int, out: Path) -> list[str]:
    module = [sys.executable, "-m", "tsc_missing.cli.batch", str(suite)]
    return [*module, f"--workers={workers}", f"--out={out}", "--no-decisions"]


def _batch(name: str, suite: Path, workers: int) -> Program:
    return Program(name, lambda out: _command(suite, workers, out))


def _bare(name: str, case: Case, at_once: int) -> Program:
    """The same runs by ``tsc-run``, so many at a time."""

    def command(out: Path) -> list[str]:
        first = case.wanted.seed
        call = shlex.join([*case.ours, "--seed={}", f"--out={out}-{{}}"])
        return ["sh", "-c", f"seq {first} {first + RUNS - 1} | xargs -P {at_once} -I{{}} {call}"]

    return Program(name, command)


def worker_memory(suite: Path, scratch: Path) -> dict[int, float]:
    """[MB]: the largest resident set that was seen of the one worker, by the run that it was at.

    A run that was over too soon to be seen is left out.
    """
    out = scratch / "memory"
    command = [*_command(suite, 1, out), f"--runs-per-process={MEMORY_RUNS}"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    peaks: dict[int, float] = {}
    while process.poll() is None:
        done = len(list((out / "runs").glob("[!.]*"))) if out.is_dir() else 0
        peaks[done] = max(peaks.get(done, 0.0), _resident(process.pid))
        time.sleep(POLL)
    if process.returncode != 0:
        raise BenchError(f"the batch for the memory ended with {process.returncode}")
    found = {done + 1: peaks[done] for done in range(MEMORY_RUNS) if peaks.get(done)}
    if not found or max(found) < MEMORY_RUNS - EARLY:
        raise BenchError(f"the memory of a worker was seen in runs {list(found)} only")
    return found


def _resident(parent: int) -> float:
    """[MB]: the resident set of the worker below a batch, 0 where there is none."""
    listing = subprocess.run(
        ["ps", "-A", "-ww", "-o", "ppid=,rss=,args="], capture_output=True, text=True, check=True
    ).stdout
    rows = (line.split(None, 2) for line in listing.splitlines())
    sizes = [float(rss) for ppid, rss, args in rows if int(ppid) == parent and "LokyProc" in args]
    return max(sizes, default=0.0) * 1024 / 1e6
