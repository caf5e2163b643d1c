"""``tsc-net show``: a network as a picture and in numbers."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tsc_missing.cli.options import (
    AdjacentOption,
    LastingOption,
    MeanOutageOption,
    NetArgument,
    make_settings,
    missing_rate,
)
from tsc_missing.config import RunSettings
from tsc_missing.errors import UserError
from tsc_missing.words import counted

if TYPE_CHECKING:
    from tsc_missing.evaluation.overview import Overview

DEFAULT = RunSettings()


def show(
    net: NetArgument,
    demand: Annotated[
        str, typer.Option(help="profile (bundled), recorded (imported), or auto.")
    ] = DEFAULT.demand,
    missing: Annotated[
        str,
        typer.Option(help="Show missing sensors: none, random, kriging, lane, burst or mixed."),
    ] = DEFAULT.missing.pattern,
    rate: Annotated[
        float | None, typer.Option(help="Share of the data that is missing, 0 to 1.")
    ] = None,
    adjacent: AdjacentOption = DEFAULT.missing.adjacent,
    lasting: LastingOption = DEFAULT.missing.lasting,
    mean_outage: MeanOutageOption = DEFAULT.missing.mean_outage,
    mask: Annotated[
        Path | None,
        typer.Option(help="Show the missing sensors of this mask.npz or CSV of outages."),
    ] = None,
    run: Annotated[
        Path | None, typer.Option(help="Show the missing sensors of this run folder.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of demand and mask.")] = DEFAULT.seed,
    horizon: Annotated[int, typer.Option(help="Seconds that are looked at.")] = DEFAULT.horizon,
    decision_interval: Annotated[
        int, typer.Option(help="Seconds between decisions.")
    ] = DEFAULT.signals.decision_interval,
    out: Annotated[
        Path | None,
        typer.Option(help="The picture to write (.png, .svg, .pdf); else NAME.png."),
    ] = None,
    labels: Annotated[
        bool, typer.Option("--labels", help="Write the intersections' ids into the picture.")
    ] = False,
    phases: Annotated[
        bool, typer.Option("--phases", help="Print the phases of every intersection.")
    ] = False,
    lanes: Annotated[
        bool, typer.Option("--lanes", help="Print the lanes of every movement's sensor.")
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object and nothing else.")
    ] = False,
) -> None:
    """Draw a network, and which of its sensors are missing, and print it in numbers."""
    from tsc_missing.evaluation.overview import look_at
    from tsc_missing.network.picture import check_picture_path, draw_network, save_picture

    settings = make_settings(
        net=net,
        demand=demand,
        missing={
            "pattern": missing if mask is None else "file",
            "rate": _rate(missing, rate, mask, run),
            "file": "" if mask is None else str(mask),
            "adjacent": adjacent,
            "lasting": lasting,
            "mean_outage": mean_outage,
        },
        seed=seed,
        horizon=horizon,
        signals={"decision_interval": decision_interval},
    )
    if out is not None:
        check_picture_path(out, "--out")
    overview = look_at(settings, run)
    target = out if out is not None else Path(f"{overview.summary.name}.png")
    figure = draw_network(
        overview.network,
        overview.roads,
        overview.summary.name,
        caption(overview),
        overview.coverage,
        labels,
    )
    save_picture(figure, target, "--out")
    _print(overview, target, as_json, phases, lanes)


def _rate(pattern: str, rate: float | None, mask: Path | None, run: Path | None) -> float:
    """The rate, once it is clear that there is one source of missing sensors and not more."""
    given = {"--missing": pattern != "none", "--mask": mask is not None, "--run": run is not None}
    chosen = [option for option, is_given in given.items() if is_given]
    if len(chosen) > 1:
        value = mask if chosen[1] == "--mask" else run
        raise UserError(chosen[1], value, f"it cannot go with {chosen[0]}")
    return missing_rate(pattern, rate)


def caption(overview: "Overview") -> str:
    """What the picture shows, in a sentence."""
    summary = overview.summary
    intersections = counted(summary.network.intersections, "intersection")
    if summary.sensors is None:
        return f"{intersections}, {counted(summary.network.roads, 'road')}"
    sensors, blind = summary.sensors, len(summary.sensors.never_observed)
    counts = [
        *([f"{blind} never"] if blind or not sensors.partly_observed else []),
        *([f"{sensors.partly_observed} partly"] if sensors.partly_observed else []),
    ]
    return (
        f"{sensors.source}: of {intersections} {' and '.join(counts)} observed; "
        f"{100 * sensors.missing_share:.1f} % of readings missing"
    )


def _print(overview: "Overview", picture: Path, as_json: bool, phases: bool, lanes: bool) -> None:
    if as_json:
        import json

        json.dump({**overview.summary.model_dump(mode="json"), "out": str(picture)}, sys.stdout)
        sys.stdout.write("\n")
        return
    from tsc_missing.cli.net_table import print_summary

    print_summary(overview.summary, picture, phases, lanes)
