"""Whole processes, measured from outside: wall time, CPU time and peak memory.

The operating system counts a child's peak memory from the moment it is forked, so what is measured
can never be below the memory of who measures. That is why this package imports nothing large
(no NumPy, none of the simulator) and leaves such work to processes of its own.
"""

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

UNIT = 1 if sys.platform == "darwin" else 1024  # of the peak memory that the system reports [B]
MEGABYTE = 1e6  # [B]
STREAM_CUT = 2000  # characters of a failed program's messages that are shown


class BenchError(RuntimeError):
    """A measurement that cannot be made, or that means nothing; the text says why."""


@dataclass(frozen=True)
class Program:
    """A command line with a name; ``command`` is given an unused path for what it writes."""

    name: str
    command: Callable[[Path], Sequence[str]]
    environment: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Cost:
    """What one process took."""

    wall: float  # [s]
    cpu: float  # [s] user and system, over all threads and children
    memory: float  # [MB] the largest resident set of it or of one of its children


def measure(program: Program) -> Cost:
    """Run the program once; its messages are shown only if it fails."""
    with tempfile.TemporaryDirectory(prefix="bench-") as scratch:
        command = [str(part) for part in program.command(Path(scratch, "out"))]
        with Path(scratch, "messages").open("w+", encoding="utf-8") as messages:
            began = time.perf_counter()
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=messages,
                stderr=subprocess.STDOUT,
                env={**os.environ, **program.environment},
            )
            _, status, usage = os.wait4(process.pid, 0)
            wall = time.perf_counter() - began
            process.returncode = os.waitstatus_to_exitcode(status)
            if process.returncode != 0:
                messages.seek(0)
                text = messages.read()[-STREAM_CUT:]
                raise BenchError(f"{program.name} ended with {process.returncode}:\n{text}")
    return Cost(wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * UNIT / MEGABYTE)


def memory_floor() -> float:
    """[MB]: the least peak memory that ``measure`` can report for any program."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * UNIT / MEGABYTE


def alternate(
    programs: Sequence[Program], rounds: int, tell: Callable[[str], None]
) -> dict[str, list[Cost]]:
    """``rounds`` costs of each program, taken in turns so that all see the same machine.

    A first round that is not counted fills the caches of the file system and of Python.
    """
    costs: dict[str, list[Cost]] = {program.name: [] for program in programs}
    for number in range(rounds + 1):
        for program in programs:
            tell(f"{'warm-up' if number == 0 else f'round {number} of {rounds}'}: {program.name}")
            cost = measure(program)
            if number:
                costs[program.name].append(cost)
    return costs


@dataclass(frozen=True)
class Spread:
    """Median and range of a few numbers."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "Spread":
        """The spread of at least one number."""
        return cls(statistics.median(values), min(values), max(values))


def spread(costs: Sequence[Cost], what: str) -> Spread:
    """The spread of one quantity (a field of ``Cost``) over rounds."""
    return Spread.of([getattr(cost, what) for cost in costs])


def ratio(costs: Sequence[Cost], base: Sequence[Cost], what: str) -> Spread:
    """The spread of the quotients of one quantity, taken round by round."""
    return Spread.of(
        [getattr(a, what) / getattr(b, what) for a, b in zip(costs, base, strict=True)]
    )
