"""Worker processes that serve several trainings: starting one takes longer than what it does."""

import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, wait
from contextlib import AbstractContextManager, contextmanager
from typing import Any

from tsc_missing.processes import leave_to_parent


class Lent:
    """A pool that somebody else closes; knows what it was asked for."""

    def __init__(self, pool: ProcessPoolExecutor) -> None:
        self._pool = pool
        self.asked: list[Future[Any]] = []

    def submit(self, *call: Any) -> Future[Any]:
        self.asked.append(self._pool.submit(*call))
        return self.asked[-1]


Lend = Callable[[int], AbstractContextManager[Lent]]


@contextmanager
def kept_worker() -> Iterator[Lend]:
    """What stands in for ``worker_processes`` where one worker is wanted: always the same one."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, context, initializer=leave_to_parent) as pool:

        @contextmanager
        def lend(workers: int) -> Iterator[Lent]:
            assert workers == 1
            lent = Lent(pool)
            try:
                yield lent
            finally:
                wait(lent.asked)

        yield lend
