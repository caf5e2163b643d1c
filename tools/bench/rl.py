"""The closed loop against sumo-rl, which commands the same phases in libsumo at the same times."""

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tools.bench.case import Case, sumo_home
from tools.bench.loop import OURS, ours, read_traffic, trip_output
from tools.bench.processes import BenchError, Program, alternate, measure
from tools.bench.report import Target, cost_table, values, verdict

RL, RL_PLAIN = "sumo-rl", "sumo-rl, no info"
TARGETS = (Target(OURS, RL, "wall", 0.8), Target(OURS, RL_PLAIN, "wall", 0.8))
LOOP = Path(__file__).parent / "programs" / "sumo_rl_loop.py"


def sumo_rl(case: Case, name: str, *extra: str) -> Program:
    """sumo-rl as it comes (``RL``), or without the statistics that it gathers at each step."""
    wanted = case.wanted
    info = "info" if name == RL else "plain"
    return Program(
        name,
        lambda _: [
            sys.executable,
            str(LOOP),
            str(case.folder),
            str(wanted.seed),
            str(wanted.horizon),
            info,
            *extra,
        ],
        {"LIBSUMO_AS_TRACI": "1", "SUMO_HOME": str(sumo_home())},
    )


def rl_traffic(case: Case) -> dict[str, Any]:
    """What became of sumo-rl's vehicles, from a run that writes its trips."""
    trips = case.folder / "sumo-rl-trips.xml"
    measure(sumo_rl(case, RL_PLAIN, *trip_output(trips)))
    return read_traffic(case, trips)


def bench_rl(case: Case, rounds: int, tell: Callable[[str], None]) -> dict[str, Any]:
    """Measure, print the table, and return the values for JSON."""
    if importlib.util.find_spec("sumo_rl") is None:
        raise BenchError("sumo-rl is not installed: pip install 'tsc-missing[bench]'")
    other = rl_traffic(case)
    programs = [ours(case), sumo_rl(case, RL), sumo_rl(case, RL_PLAIN)]
    costs = alternate(programs, rounds, tell)
    print(f"\nThe same phases through sumo-rl: {case.controller}, {case.wanted.net}")
    print(cost_table(costs, RL))
    print(_compared(case.content["traffic"], other))
    print("\n".join(verdict(target, costs) for target in TARGETS))
    return {
        "controller": case.controller,
        "traffic": {OURS: case.content["traffic"], RL: other},
        **values(costs, RL),
    }


def _compared(mine: dict[str, Any], other: dict[str, Any]) -> str:
    """How far the traffic is the same, in words.

    It need not be to the second: in the yellow between two phases sumo-rl lets a link that stays
    green keep its priority, where ours gives way as long as either phase has it give way.
    """
    ratio = other["att_all"] / mine["att_all"] - 1.0
    here, there = (
        f"{one['finished']} of {one['demand']} finished, {one['att_all']:.1f} s on average"
        for one in (mine, other)
    )
    return f"traffic: {here} here, {there} there ({ratio:+.2%} travel time)"
