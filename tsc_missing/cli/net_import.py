"""``tsc-net import``: CityFlow files, a SUMO net, or an OSM extract."""

from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import ValidationError

from tsc_missing.cli.net_target import find_target, say_written
from tsc_missing.errors import UserError

CITYFLOW_HORIZON = 3600
COURSE, THROUGH = "constant", 0.5  # of generated demand, where not given


def import_network(
    roadnet: Annotated[
        Path | None, typer.Option(help="CityFlow's road network, a JSON file.")
    ] = None,
    flow: Annotated[
        Path | None, typer.Option(help="CityFlow's flow, a JSON file: the recorded demand.")
    ] = None,
    sumo_net: Annotated[
        Path | None,
        typer.Option(help="A SUMO net (.net.xml), or a .sumocfg that names net, routes and times."),
    ] = None,
    osm: Annotated[
        Path | None, typer.Option(help="An OpenStreetMap extract (.osm); needs netconvert.")
    ] = None,
    routes: Annotated[
        list[Path] | None,
        typer.Option(
            help="SUMO demand (.rou.xml: trips, flows, vehicles), beside a .sumocfg's; may be "
            "repeated."
        ),
    ] = None,
    signals: Annotated[
        list[str] | None,
        typer.Option(help="A signal to control, by its id; may be repeated. Default: all."),
    ] = None,
    begin: Annotated[
        float | None, typer.Option(help="Where SUMO's clock begins, s. Default: the .sumocfg's, 0.")
    ] = None,
    left_hand: Annotated[
        bool, typer.Option("--left-hand", help="An OSM extract of where traffic drives left.")
    ] = False,
    vehicles_per_hour: Annotated[
        float | None, typer.Option(help="Generate so much demand, where there are no routes.")
    ] = None,
    course: Annotated[
        str | None,
        typer.Option(
            help=f"Generated demand: constant, peak, ramp or gaussian over time. Default: {COURSE}."
        ),
    ] = None,
    through: Annotated[
        float | None,
        typer.Option(
            help=f"Generated demand: the share that only passes through. Default: {THROUGH}."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of generated demand and random flows.")] = 0,
    as_name: Annotated[
        str | None, typer.Option("--as", help="A name to keep it under, for tsc-run --net NAME.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="A new folder to write it to, for tsc-run --net DIR.")
    ] = None,
    horizon: Annotated[
        int | None,
        typer.Option(min=1, help="Keep trips departing within it, s. Default: .sumocfg's, 3600."),
    ] = None,
    all_phases: Annotated[
        bool,
        typer.Option(help="Keep every phase, not only as many as serve all movements."),
    ] = False,
) -> None:
    """Import a CityFlow road network and flow, a SUMO net with its demand, or an OSM extract."""
    given = {"--roadnet": roadnet, "--sumo-net": sumo_net, "--osm": osm}
    chosen = [option for option, path in given.items() if path is not None]
    if len(chosen) != 1:
        value = given[chosen[1]] if chosen else "nothing"
        raise UserError(
            chosen[1] if chosen else "--roadnet",
            value,
            "give one of --roadnet (CityFlow), --sumo-net and --osm",
        )
    only_sumo = {
        "--routes": routes,
        "--signals": signals,
        "--begin": begin,
        "--vehicles-per-hour": vehicles_per_hour,
    }
    foreign: dict[str, Any] = only_sumo if roadnet is not None else {"--flow": flow}
    if osm is None:
        foreign["--left-hand"] = "set" if left_hand else None
    _refuse(foreign, f"it cannot go with {chosen[0]}")
    if vehicles_per_hour is None:
        shape = {"--course": course, "--through": through}
        _refuse(shape, "it shapes generated demand, which needs --vehicles-per-hour")
    target, name, field = find_target(as_name, out)
    if roadnet is not None:
        from tsc_missing.network.importing import import_cityflow

        kept = horizon or CITYFLOW_HORIZON
        manifest = import_cityflow(roadnet, flow, target, name, kept, all_phases, field)
    else:
        from tsc_missing.network.importing_sumo import SumoImport, import_sumo

        source = sumo_net if sumo_net is not None else osm
        assert source is not None
        wanted = SumoImport(
            source=source,
            kind="osm" if osm is not None else "sumo",
            routes=tuple(routes or ()),
            signals=tuple(signals or ()),
            begin=begin,
            horizon=horizon,
            all_phases=all_phases,
            demand=demand_spec(
                vehicles_per_hour=vehicles_per_hour,
                course=course if course is not None else COURSE,
                through=through if through is not None else THROUGH,
            )
            if vehicles_per_hour is not None
            else None,
            seed=seed,
            left_hand=left_hand,
        )
        manifest = import_sumo(wanted, target, name, field)
    say_written(manifest, target)


def _refuse(options: dict[str, Any], why: str) -> None:
    for option, value in options.items():
        if value is not None and value != []:
            raise UserError(option, value, why)


def demand_spec(**values: Any) -> Any:
    """What demand to generate; ``UserError`` names the option that is wrong."""
    from tsc_missing.cli.options import option_error
    from tsc_missing.demand.generate import DemandSpec

    try:
        return DemandSpec.model_validate(values)
    except ValidationError as error:
        raise option_error(error, whole="turns") from None
