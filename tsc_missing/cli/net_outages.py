"""``tsc-net outages``: a suite that takes a network's sensors away one after the other."""

import shlex
from pathlib import Path
from typing import Annotated, Literal

import typer

from tsc_missing.cli.options import NetArgument
from tsc_missing.config import RunSettings
from tsc_missing.errors import UserError

DEFAULT = RunSettings()


def outages(
    net: NetArgument,
    out: Annotated[Path, typer.Option(help="The folder to write: lists of outages, suite.toml.")],
    each: Annotated[
        Literal["intersection", "approach"], typer.Option(help="What goes silent, one by one.")
    ] = "intersection",
    method: Annotated[
        list[str] | None,
        typer.Option(
            help="A controller or a method of suites; repeatable.",
            show_default=DEFAULT.controller,
        ),
    ] = None,
    seeds: Annotated[
        int,
        typer.Option(
            min=1, help="How many seeds, from 0: of the bundled demand, and of what methods draw."
        ),
    ] = 3,
) -> None:
    """Write a suite that takes the sensors away one after the other: which is missed most?"""
    from tsc_missing.batch.outage_suite import SUITE, write_outage_suite
    from tsc_missing.batch.suite import bundled_methods
    from tsc_missing.controllers.catalogue import NATIVE, looks_at_nothing, require_controller
    from tsc_missing.evaluation.scenario import find_scenario

    scenario = find_scenario(net, DEFAULT.demand)
    methods = list(dict.fromkeys(method or [DEFAULT.controller]))
    for name in methods:
        if looks_at_nothing(name):
            raise UserError("--method", name, "it reads no sensor, so it has none to miss")
        if name not in (*bundled_methods(), *NATIVE):
            try:
                require_controller(name)
            except UserError as error:
                raise UserError("--method", name, error.allowed) from None
    horizon = round(scenario.folder.manifest.horizon or DEFAULT.horizon)
    block = {"method": methods, "net": net, "seed": list(range(seeds)), "horizon": horizon}
    names = write_outage_suite(scenario.folder.network, out, each == "approach", block)
    runs = (len(names) + 1) * len(methods) * seeds
    print(f"{len(names)} lists of outages; the suite has {runs} runs:\n")
    suite, results = shlex.quote(str(out / SUITE)), shlex.quote(str(out / "runs"))
    print(f"  tsc-batch {suite} --out {results}")
    print(f"  tsc-report {results}")
