"""``tsc-net outages``: a suite that takes a network's sensors away one after the other."""

import shlex
from pathlib import Path
from typing import Annotated, Literal

import typer

from tsc_missing.cli.options import NetArgument, make_settings
from tsc_missing.config import RunSettings

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
    seeds: Annotated[int, typer.Option(min=1, help="How many seeds, from 0.")] = 3,
) -> None:
    """Write a suite that takes the sensors away one after the other: which is missed most?"""
    from tsc_missing.batch.outage_suite import SUITE, write_outage_suite
    from tsc_missing.evaluation.overview import find_network

    folder, _ = find_network(make_settings(net=net))
    methods = list(dict.fromkeys(method or [DEFAULT.controller]))
    names = write_outage_suite(folder.network, net, out, each == "approach", methods, seeds)
    runs = (len(names) + 1) * len(methods) * seeds
    print(f"{len(names)} lists of outages; the suite has {runs} runs:\n")
    suite, results = shlex.quote(str(out / SUITE)), shlex.quote(str(out / "runs"))
    print(f"  tsc-batch {suite} --out {results}")
    print(f"  tsc-report {results}")
