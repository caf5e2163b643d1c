"""Processes that run simulations, one at a time each."""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager

LOOK = 0.5  # [s] between two looks whether the parent is there


@contextmanager
def worker_processes(workers: int) -> Iterator[ProcessPoolExecutor]:
    """A pool of spawned processes that end with the block, even in the middle of a run.

    They also end if this process is killed.
    """
    context = multiprocessing.get_context("spawn")
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, context, initializer=leave_to_parent)
    try:
        yield pool
    except BaseException:
        for child in set(multiprocessing.active_children()) - others:
            child.kill()
            child.join()
        pool.shutdown(cancel_futures=True)  # waits for its thread, which else fails at the exit
        raise
    pool.shutdown()


def leave_to_parent() -> None:
    """Ctrl-C and SIGTERM are for the parent, which ends its processes; they do not outlive it."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(LOOK)
    os._exit(1)
