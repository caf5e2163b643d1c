"""The closed loop against the bare simulator on the same net, routes and signal plan."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tools.bench.case import Case, run_module, sumo_program
from tools.bench.processes import Cost, Program, alternate, measure, memory_floor
from tools.bench.report import Target, cost_table, values, verdict

OURS, BARE, OUTPUTS, LIBSUMO = "tsc-run", "sumo", "sumo, our outputs", "libsumo"
TARGETS = (Target(OURS, BARE, "wall", 1.10), Target(OURS, BARE, "memory", 1.3))
CALL = Path(__file__).parent / "programs" / "bare_libsumo.py"


def ours(case: Case) -> Program:
    """The whole command, without decisions.parquet."""
    return Program(OURS, lambda out: [*case.ours, f"--out={out}"])


def bare(case: Case) -> Program:
    """The simulator's executable, which writes nothing."""
    return Program(BARE, lambda _: [sumo_program(), case.end, *case.sumo_arguments()])


def with_outputs(case: Case) -> Program:
    """The executable with the outputs that every result is read from (trips, totals, lanes)."""
    lanes = str(case.folder / "run" / "lanes.add.xml")
    return Program(
        OUTPUTS,
        lambda out: [
            sumo_program(),
            case.end,
            *case.sumo_arguments(lanes),
            *trip_output(Path(f"{out}.trips")),
            f"--statistic-output={out}.statistics",
        ],
    )


def libsumo(case: Case) -> Program:
    """The least that a Python program can do that runs the simulation in libsumo."""
    horizon = str(case.wanted.horizon)
    return Program(LIBSUMO, lambda _: [sys.executable, str(CALL), horizon, *case.sumo_arguments()])


def bare_traffic(case: Case) -> dict[str, Any]:
    """What became of the vehicles of the bare simulation, from a run that writes its trips."""
    trips = case.folder / "bare-trips.xml"
    command = [sumo_program(), case.end, *case.sumo_arguments(), *trip_output(trips)]
    measure(Program(BARE, lambda _: command))
    return read_traffic(case, trips)


def trip_output(target: Path) -> tuple[str, ...]:
    """The options that make SUMO write a record a trip, whatever became of it."""
    return (
        f"--tripinfo-output={target}",
        "--tripinfo-output.write-unfinished",
        "--tripinfo-output.write-undeparted",
    )


def read_traffic(case: Case, trips: Path) -> dict[str, Any]:
    """The counts and sums of a trip output that a simulation of the case wrote."""
    text = run_module("traffic", str(case.folder), str(trips), str(case.wanted.horizon))
    found: dict[str, Any] = json.loads(text)
    return found


def same_traffic(case: Case, other: dict[str, Any]) -> str:
    """One line on whether another simulation moved every vehicle as ours did."""
    mine = case.content["traffic"]
    if mine == other:
        return (
            f"same traffic: yes, all {mine['demand']} trips to the second "
            f"({mine['finished']} finished, {mine['travel_time']:.0f} s in all)"
        )
    return (
        f"same traffic: NO. Finished {mine['finished']} here, {other['finished']} there; travel "
        f"time {mine['travel_time']:.0f} s here, {other['travel_time']:.0f} s there"
    )


def bench_loop(case: Case, rounds: int, tell: Callable[[str], None]) -> dict[str, Any]:
    """Measure, print the table, and return the values for JSON."""
    other = bare_traffic(case)
    costs = alternate([ours(case), bare(case), with_outputs(case), libsumo(case)], rounds, tell)
    print(f"\nClosed loop against the bare simulator: {case.controller}, {case.wanted.net}")
    print(cost_table(costs, BARE))
    print(same_traffic(case, other))
    void = case.content["traffic"] != other
    if void:
        print("The comparison is void: the two did not simulate the same.")
    else:
        print("\n".join(verdict(target, costs) for target in TARGETS))
        print(_share_of_libsumo(costs))
    return {
        "controller": case.controller,
        "void": void,
        "traffic": {OURS: case.content["traffic"], BARE: other},
        "memory floor": memory_floor(),
        **values(costs, BARE),
    }


def _share_of_libsumo(costs: dict[str, list[Cost]]) -> str:
    """What of our extra cost any program on libsumo has, in words."""

    def extra(program: str, what: str) -> float:
        pairs = zip(costs[program], costs[BARE], strict=True)
        differences = sorted(getattr(a, what) - getattr(b, what) for a, b in pairs)
        return float(differences[len(differences) // 2])

    mine, least = (
        f"{extra(program, 'wall'):+.2f} s, {extra(program, 'cpu'):+.2f} s CPU, "
        f"{extra(program, 'memory'):+.0f} MB"
        for program in (OURS, LIBSUMO)
    )
    return f"beyond {BARE}: {mine}; of that a bare {LIBSUMO} program already has {least}"
