"""Runs a controller once and writes down all that other programs need to repeat its traffic."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any
from unittest import mock
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import typer

from tools.bench.case import CASE
from tools.bench.programs.traffic import traffic
from tsc_missing.config import RunSettings
from tsc_missing.evaluation.closed_loop import run_closed_loop
from tsc_missing.evaluation.run import Options, prepare
from tsc_missing.network.model import Network
from tsc_missing.simulation.engine import OPTIONS
from tsc_missing.simulation.outputs import OutputFiles
from tsc_missing.simulation.signals import SignalGuard
from tsc_missing.simulation.states import green_state

PROGRAM_ID = "bench"
Sent = dict[str, dict[int, str]]  # signal -> time [s] -> the state that it was left in


def main(
    net: Annotated[str, typer.Option()],
    demand: Annotated[str, typer.Option()],
    horizon: Annotated[int, typer.Option()],
    seed: Annotated[int, typer.Option()],
    controller: Annotated[str, typer.Option()],
    folder: Annotated[Path, typer.Option()],
) -> None:
    """Write ``case.json`` and the files that it names into ``folder``."""
    settings = RunSettings.model_validate(
        {"net": net, "demand": demand, "horizon": horizon, "seed": seed, "controller": controller}
    )
    prepared = prepare(settings, Options())
    run = folder / "run"
    run.mkdir(parents=True)
    sent: Sent = {}
    with mock.patch.object(SignalGuard, "send", _recorded(sent)):
        trace = run_closed_loop(prepared.scene, settings, prepared.controller, run)
    network = prepared.scene.network
    plan, phases_net = folder / "plan.add.xml", folder / "phases.net.xml"
    plan.write_text(_plan(sent, horizon), encoding="utf-8")
    _write_phases_net(network, prepared.scene.net_file, phases_net)
    scheduled = [trip.depart for trip in prepared.scene.demand.trips]
    content: dict[str, Any] = {
        "net": str(prepared.scene.net_file),
        "routes": str(run / "demand.rou.xml"),
        "plan": str(plan),
        "phases_net": str(phases_net),
        "options": list(OPTIONS),
        "signals": settings.signals.model_dump(),
        "ids": list(network.ids),
        "phases": trace.phase.tolist(),
        "scheduled": scheduled,
        "traffic": traffic(OutputFiles(run).trips, scheduled, horizon),
    }
    (folder / CASE).write_text(json.dumps(content), encoding="utf-8")


def _recorded(sent: Sent) -> Callable[[SignalGuard, int, str, float], None]:
    """``SignalGuard.send`` that also notes each state."""
    send = SignalGuard.send

    def recorded(guard: SignalGuard, n: int, state: str, time: float) -> None:
        send(guard, n, state, time)
        sent.setdefault(guard._nodes[n].id, {})[int(time)] = state

    return recorded


def _plan(sent: Sent, horizon: int) -> str:
    """The states as static programs, one phase for as long as a state stayed."""
    lines = ["<additional>"]
    for name, states in sent.items():
        lines.append(
            f'<tlLogic id={quoteattr(name)} type="static" programID="{PROGRAM_ID}" offset="0">'
        )
        times = [time for time in states if time < horizon]
        lines += [
            f'  <phase duration="{until - time}" state="{states[time]}"/>'
            for time, until in zip(times, [*times[1:], horizon], strict=True)
        ]
        lines.append("</tlLogic>")
    return "\n".join([*lines, "</additional>", ""])


def _write_phases_net(network: Network, net_file: Path, target: Path) -> None:
    """Copy the net with the green states of each signal's phases, in their order, as its program.

    A program that finds its phases in the net, as sumo-rl does, then has the same ones.
    """
    tree = ElementTree.parse(net_file)
    nodes = {node.id: node for node in network.intersections}
    for logic in tree.iter("tlLogic"):
        node = nodes[logic.attrib["id"]]
        for phase in list(logic):
            logic.remove(phase)
        for number in range(len(node.phases)):
            state = green_state(node, number)
            ElementTree.SubElement(logic, "phase", {"duration": "60", "state": state})
    tree.write(target, encoding="utf-8")


if __name__ == "__main__":
    typer.run(main)
