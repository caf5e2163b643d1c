"""A worker: one process that runs one simulation after the other, and who looks after it.

Each worker is a loky executor of its own with a single process (loky is what joblib runs its
processes with). A shared executor would be simpler, but it gives up all of its processes where
one of them dies; so a crash, a kill or a time-out costs the run that it happened to and no other.
"""

import contextlib
import multiprocessing
import os
import shutil
import signal
import tempfile
import threading
import time
from concurrent.futures import BrokenExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tsc_missing.batch.folder import Failure, clear_leftovers
from tsc_missing.batch.task import Task, run_task
from tsc_missing.own_code import is_own
from tsc_missing.processes import leave_to_parent
from tsc_missing.versions import versions

stopping = threading.Event()  # set while this process ends its workers
# loky replaces a process that has grown by more than this since its first call, and warns of a
# leak. The first run that loads torch grows by more; here processes are replaced by number of runs.
GROWTH = {"LOKY_MAX_MEMORY_LEAK_SIZE": "1e15"}  # [B], so never
THREADS = ("OMP", "OPENBLAS", "MKL", "NUMEXPR")
GRACE = 10.0  # [s] that a process has to end by itself after its last run
IDLE = 60.0  # [s] after which a process without a run ends by itself


@dataclass(frozen=True)
class Care:
    """How a worker looks after its runs."""

    timeout: float | None = None  # [s] of one attempt
    retries: int = 0  # further attempts after a crash, an error or a time-out
    runs_per_process: int = 25  # after which a process is replaced


@dataclass(frozen=True)
class Outcome:
    """What became of a run; ``failure`` is None where its folder is there."""

    name: str
    failure: Failure | None
    seconds: float


class Worker:
    """One process at a time; used by one thread."""

    def __init__(self) -> None:
        self._executor: Any = None
        self._scratch: Path | None = None
        self._runs = 0
        self._last = 0.0
        self.process: int | None = None  # its id
        self.busy = False

    def attempt(self, task: Task, care: Care) -> Failure | None:
        """Run it once."""
        self._ready(care.runs_per_process)
        if stopping.is_set():  # else a process that came up just now would outlive ``kill_all``
            return _failure("crash", "the batch was stopped")
        self.busy = True
        try:
            found: Failure | None = self._executor.submit(run_task, task).result(care.timeout)
        except TimeoutError:
            self._kill(task)
            return _failure("timeout", f"it took more than {care.timeout:g} s")
        except BrokenExecutor as error:
            self._kill(task)
            codes = str(error).partition("exit codes of the workers are {")[2].partition("}")[0]
            return _failure("crash", f"its process ended with {codes or 'no exit code'}")
        finally:
            self.busy = False
            self._last = time.monotonic()
        self._runs += 1
        if is_own(task.settings.controller) or is_own(task.settings.imputer):
            self.close()  # what it keeps, or did to the process, is of one run
        return found

    def _ready(self, runs_per_process: int) -> None:
        """Have a process that has not run too often, and is not about to end for idleness."""
        idle = time.monotonic() - self._last > IDLE / 2
        if self._executor is not None and (self._runs >= runs_per_process or idle):
            self.close()
        if self._executor is None:
            from loky import ProcessPoolExecutor

            if multiprocessing.current_process().daemon:
                # Daemons may have no children. Dask's workers are daemons so that they end with
                # their nanny; the runs end with the worker (``leave_to_parent``).
                multiprocessing.current_process()._config["daemon"] = False  # type: ignore[attr-defined]
            self._scratch = Path(tempfile.mkdtemp(prefix="tsc-batch-"))
            threads = {f"{name}_NUM_THREADS": "1" for name in THREADS}
            self._executor = ProcessPoolExecutor(
                1,
                timeout=IDLE,
                initializer=leave_to_parent,
                env={**threads, **GROWTH, "TMPDIR": str(self._scratch)},
            )
            self._runs = 0
            self.process = self._executor.submit(os.getpid).result()

    def _kill(self, task: Task) -> None:
        self.close(kill=True)
        clear_leftovers(task.folder.parent.parent, task.name)

    def close(self, kill: bool = False) -> None:
        """End the process, at once or after its run."""
        if self._executor is not None:
            last = threading.Timer(GRACE, _end, [self.process])  # own code may have left a thread
            last.daemon = True
            last.start()
            self._executor.shutdown(wait=True, kill_workers=kill)
            last.cancel()
        if self._scratch is not None:
            shutil.rmtree(self._scratch, ignore_errors=True)
        self._executor = self._scratch = self.process = None


def _end(process: int | None) -> None:
    if process is not None:
        with contextlib.suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)


def _failure(kind: str, error: str) -> Failure:
    return Failure.model_validate({"kind": kind, "error": error, "versions": versions()})


_mine = threading.local()
_workers: list[Worker] = []


def supervise(task: Task, care: Care) -> Outcome:
    """Run it in this thread's worker, again if that was asked for; never raises."""
    began = time.monotonic()
    if not hasattr(_mine, "worker"):
        _mine.worker = Worker()
        _workers.append(_mine.worker)
    worker: Worker = _mine.worker
    attempts = 0
    failure: Failure | None = None
    while attempts <= care.retries:
        attempts += 1
        try:
            failure = worker.attempt(task, care)
        except Exception as error:
            worker.close(kill=True)
            failure = _failure("crash", f"no worker could be had: {type(error).__name__}: {error}")
        if failure is None or failure.kind == "refused" or stopping.is_set():
            break
    if failure is not None:
        failure = failure.model_copy(update={"attempts": attempts})
    return Outcome(task.name, failure, time.monotonic() - began)


def busy() -> int:
    """How many of this process's workers have a run."""
    return sum(worker.busy for worker in list(_workers))


def kill_all() -> None:
    """End all workers of this process at once."""
    for worker in list(_workers):
        _end(worker.process)


def close_all() -> None:
    """End all workers of this process, which have no runs."""
    while _workers:
        _workers.pop().close()
