"""A worker's process: kept for as long as it works, and replaced by number of runs."""

import os
import threading
import time
import warnings

import pytest

from tsc_missing.batch.worker import Worker

MUCH = 400_000_000  # [B], more than loky lets a process grow


def grow() -> int:
    """Keep much memory, as the first run with a network does, for longer than loky looks away."""
    kept = globals().setdefault("kept", [])
    kept.append(b"x" * MUCH)
    time.sleep(1.1)
    return os.getpid()


def test_a_process_that_grows_stays_and_nothing_is_said_of_it():
    pytest.importorskip("psutil")  # without it loky does not look at memory
    worker = Worker()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            worker._ready(runs_per_process=9)
            first = worker.process
            calls = [worker._executor.submit(call) for call in (grow, os.getpid, os.getpid)]
            found = [call.result(60) for call in calls]
        finally:
            worker.close()
    assert found == [first] * 3
    assert [str(each.message) for each in said] == []


def leave_a_thread() -> None:
    """As a controller of one's own may."""
    threading.Thread(target=time.sleep, args=(600,)).start()


def test_a_process_that_does_not_end_is_ended(monkeypatch):
    monkeypatch.setattr("tsc_missing.batch.worker.GRACE", 0.5)
    worker = Worker()
    worker._ready(runs_per_process=9)
    worker._executor.submit(leave_a_thread).result(60)
    began = time.monotonic()
    worker.close()
    assert time.monotonic() - began < 60
    assert worker.process is None


def test_processes_are_replaced_by_number_of_runs():
    worker = Worker()
    try:
        worker._ready(runs_per_process=2)
        first = worker.process
        worker._last = time.monotonic()
        worker._runs = 1
        worker._ready(runs_per_process=2)
        assert worker.process == first
        worker._runs = 2
        worker._ready(runs_per_process=2)
        assert worker.process != first
    finally:
        worker.close()
