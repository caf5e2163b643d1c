"""The closed loop against the bare simulator in instructions, which no neighbour can change."""

import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from tools.bench.case import Case
from tools.bench.loop import BARE, LIBSUMO, OURS, OUTPUTS, bare, libsumo, ours, with_outputs
from tools.bench.processes import BenchError, Program, measure
from tools.bench.report import table

LIMIT = 1.10  # times the bare simulator's


def bench_instructions(case: Case, rounds: int, tell: Callable[[str], None]) -> dict[str, Any]:
    """Count each program once under valgrind, print the table, and return the counts for JSON.

    ``rounds`` does not matter: a second count differs by less than is printed.
    """
    counts: dict[str, int] = {}
    for program in (ours(case), bare(case), with_outputs(case), libsumo(case)):
        tell(f"counting {program.name}")
        counts[program.name] = count(program, case.folder / "instructions")
    shares = {name: counts[name] / counts[BARE] for name in (OURS, OUTPUTS, LIBSUMO)}
    print(f"\nInstructions of a whole process: {case.controller}, {case.wanted.net}")
    rows = [
        [name, f"{number / 1e9:.2f}", f"{number / counts[BARE]:.3f}"]
        for name, number in counts.items()
    ]
    print(table(["", "10⁹", f"/ {BARE}"], rows))
    met = "met" if shares[OURS] <= LIMIT else "MISSED"
    print(f"instructions: {OURS} / {BARE} = {shares[OURS]:.3f}, target at most {LIMIT:g}: {met}")
    return {"controller": case.controller, "instructions": counts, f"ratios to {BARE}": shares}


def count(program: Program, folder: Path) -> int:
    """The instructions of the program and all that it starts; ``folder`` is emptied."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    measure(replace(program, command=lambda out: [*_counted(folder), *program.command(out)]))
    found = [_total(path) for path in folder.iterdir()]
    return sum(found)


def _counted(folder: Path) -> list[str]:
    """The command line that counts what follows it, a file a process."""
    valgrind = shutil.which("valgrind")
    if valgrind is None:
        raise BenchError("counting instructions needs valgrind, which is not installed")
    return [
        valgrind,
        "--tool=cachegrind",
        "--cache-sim=no",
        "--trace-children=yes",
        f"--cachegrind-out-file={folder}/%p",
    ]


def _total(path: Path) -> int:
    found = re.search(r"^summary: (\d+)", path.read_text(encoding="utf-8"), re.MULTILINE)
    if found is None:
        raise BenchError(f"valgrind wrote no total for process {path.name}")
    return int(found.group(1))
