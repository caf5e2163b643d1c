"""``tsc-net check``: what is odd about a network."""

import json
import sys
from typing import Annotated

import typer
from rich.console import Console

from tsc_missing.cli.options import NetArgument, make_settings
from tsc_missing.config import RunSettings

DEFAULT = RunSettings()


def check(
    net: NetArgument,
    demand: Annotated[
        str, typer.Option(help="profile (bundled), recorded (imported), or auto.")
    ] = DEFAULT.demand,
    seed: Annotated[int, typer.Option(help="Seed of a profile's demand.")] = DEFAULT.seed,
    horizon: Annotated[int, typer.Option(help="Seconds of demand to look at.")] = DEFAULT.horizon,
    detector_length: Annotated[
        float, typer.Option(help="Metres that an area detector covers.")
    ] = DEFAULT.sensor.length,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object and nothing else.")
    ] = False,
) -> None:
    """List in words what is odd about a network: roads, signals, phases, sensors, demand."""
    from tsc_missing.evaluation.check import check_network
    from tsc_missing.evaluation.overview import find_network

    settings = make_settings(
        net=net,
        demand=demand,
        seed=seed,
        horizon=horizon,
        sensor={"kind": "area", "length": detector_length},
    )
    folder, scenario = find_network(settings)
    found = scenario.demand(settings) if scenario is not None else None
    findings = check_network(folder, found, settings)
    if as_json:
        json.dump(
            {"name": folder.manifest.name, "findings": [f.model_dump() for f in findings]},
            sys.stdout,
        )
        sys.stdout.write("\n")
        return
    console = Console(highlight=False, soft_wrap=True)
    for finding in findings:
        console.print(str(finding), markup=False)
    if not findings:
        console.print("nothing odd", markup=False)
