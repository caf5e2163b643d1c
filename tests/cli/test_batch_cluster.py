"""``tsc-batch --cluster``: two Dask workers on loopback, one of them killed midway."""

import json
import os
import signal
import subprocess
import sys

import pytest

from tests.batch.cases import (
    PATIENCE,
    descendants,
    finished,
    half_written,
    rows,
    start,
    wait_for,
    write_suite,
)

OWN = """
from tsc_missing.controllers.max_queue import MaxQueue


class Mine(MaxQueue):
    pass
"""

pytest.importorskip("distributed", reason="Dask is not installed (the extra cluster)")


@pytest.fixture
def cluster(tmp_path):
    """The scheduler's address, and its workers: each a nanny with the worker below it.

    They stand in a folder of their own.
    """
    file = tmp_path / "cluster" / "scheduler.json"
    file.parent.mkdir()
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": file.parent}
    dask = [sys.executable, "-m", "dask"]
    local = ["--host", "127.0.0.1", "--no-dashboard"]
    processes = [
        subprocess.Popen(
            [*dask, "scheduler", *local, "--port", "0", f"--scheduler-file={file}"], **quiet
        )
    ]
    try:
        wait_for(file.exists)
        worker = [*dask, "worker", *local, f"--scheduler-file={file}", "--nthreads", "1"]
        processes += [subprocess.Popen(worker, **quiet) for _ in range(2)]
        yield json.loads(file.read_text())["address"], processes[1:]
    finally:
        for process in reversed(processes):
            process.terminate()
        for process in processes:
            process.wait(60)


def test_two_workers_one_killed_midway(command, small_net, cluster):
    address, (victim, _) = cluster
    (command.cwd / "mine.py").write_text(OWN)
    write_suite(command, small_net, methods='["max-queue", "mine.py:Mine"]', horizon=300)
    alone = command("batch", "small.toml", "--workers", 1, "--out", "alone")
    assert alone.returncode == 0, alone.stderr

    out = command.cwd / "b"
    process = start(command, "small.toml", "--out", "b", "--cluster", address)
    wait_for(lambda: half_written(out))

    def running():
        """The victim's worker once it has a process that runs a simulation."""
        below = descendants(victim.pid)
        busy = any("LokyProcess" in words for words in below.values())
        return [p for p, words in below.items() if "spawn_main" in words] if busy else []

    for worker in wait_for(running):
        os.kill(worker, signal.SIGKILL)
    text, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, errors
    assert "4 of 4 runs finished" in text
    assert len(finished(out)) == 4
    assert rows(out) == rows(command.cwd / "alone")
