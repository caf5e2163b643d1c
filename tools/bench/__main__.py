"""``python -m tools.bench``: runs the benchmarks and prints their tables."""

import json
import os
import sys
import tempfile
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from tools.bench.batch import bench_batch
from tools.bench.case import Case, Wanted, make_case
from tools.bench.costs import bench_costs
from tools.bench.instructions import bench_instructions
from tools.bench.loop import bench_loop
from tools.bench.processes import BenchError
from tools.bench.report import machine
from tools.bench.rl import bench_rl


class Name(StrEnum):
    """The benchmarks."""

    LOOP = "loop"
    INSTRUCTIONS = "instructions"
    SUMO_RL = "sumo-rl"
    COSTS = "costs"
    BATCH = "batch"


Bench = Callable[[Case, int, Callable[[str], None]], dict[str, Any]]
BENCHES: dict[Name, Bench] = {
    Name.LOOP: bench_loop,
    Name.INSTRUCTIONS: bench_instructions,
    Name.SUMO_RL: bench_rl,
    Name.COSTS: bench_costs,
    Name.BATCH: bench_batch,
}

USUAL = [name for name in BENCHES if name is not Name.INSTRUCTIONS]  # which takes an hour


def main(
    names: Annotated[
        list[Name] | None,
        typer.Argument(
            help="loop: against bare SUMO; instructions: the same, counted by valgrind; sumo-rl; "
            "costs: where time goes; batch: tsc-batch."
        ),
    ] = None,
    net: Annotated[str, typer.Option(help="As of tsc-run.")] = "jinan",
    demand: Annotated[str, typer.Option(help="As of tsc-run.")] = "auto",
    controller: Annotated[
        list[str] | None,
        typer.Option(help="One or more; loop measures each, the others the first."),
    ] = None,
    horizon: Annotated[int, typer.Option(help="Simulated seconds.")] = 3600,
    seed: Annotated[int, typer.Option(help="Seed of demand and simulator.")] = 0,
    rounds: Annotated[int, typer.Option(min=1, help="Runs of each program.")] = 5,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write every number to this file.")
    ] = None,
) -> None:
    """Measure whole processes, in turns, and print medians with lowest and highest."""
    wanted = Wanted(net, demand, horizon, seed)
    controllers = controller or ["fixed-time-15", "fixed-time"]
    found: dict[str, Any] = {"machine": machine(), "wanted": vars(wanted), "rounds": rounds}
    with tempfile.TemporaryDirectory(prefix="bench-") as scratch:
        _keep_byte_code(Path(scratch, "byte-code"))
        try:
            for number, one in enumerate(controllers):
                _tell(f"recording {one}")
                case = make_case(wanted, one, Path(scratch, one))
                for name in names or USUAL:
                    if number == 0 or name in (Name.LOOP, Name.INSTRUCTIONS):
                        found.setdefault(name, []).append(BENCHES[name](case, rounds, _tell))
        except BenchError as error:
            print(f"error: {error}", file=sys.stderr)
            raise typer.Exit(1) from None
    if json_file is not None:
        json_file.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def _keep_byte_code(folder: Path) -> None:
    """Let the measured Python programs cache their byte code, as installed ones do."""
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    os.environ["PYTHONPYCACHEPREFIX"] = str(folder)


def _tell(text: str) -> None:
    """What is being done now, on the error stream if someone watches."""
    if sys.stderr.isatty():
        print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)


if __name__ == "__main__":
    typer.run(main)
