"""``tsc-net generate``: a grid with demand from a few numbers."""

from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import ValidationError

from tsc_missing.cli.net_import import demand_spec
from tsc_missing.cli.net_target import find_target, say_written
from tsc_missing.cli.options import option_error
from tsc_missing.errors import UserError
from tsc_missing.network.grid import GridSpec

DEFAULT = GridSpec(rows=1, columns=1, east_west=400.0, north_south=400.0)


def generate(
    context: typer.Context,
    rows: Annotated[int, typer.Option(min=1, max=50, help="Of intersections, south to north.")] = 3,
    columns: Annotated[
        int, typer.Option(min=1, max=50, help="Of intersections, west to east.")
    ] = 3,
    east_west: Annotated[float, typer.Option(help="Metres between columns.")] = DEFAULT.east_west,
    north_south: Annotated[float, typer.Option(help="Metres between rows.")] = DEFAULT.north_south,
    lanes: Annotated[
        str,
        typer.Option(help="A number of lanes, or each lane's turns from the middle out: l,s,sr."),
    ] = "3",
    side_lanes: Annotated[
        str | None,
        typer.Option(help="The same for north-south roads: the side roads of an arterial."),
    ] = None,
    speed: Annotated[float, typer.Option(help="Speed limit, m/s.")] = DEFAULT.speed,
    side_speed: Annotated[
        float | None, typer.Option(help="Speed limit of north-south roads, m/s.")
    ] = None,
    remove: Annotated[
        list[str] | None,
        typer.Option(help="A road to leave out, as 1,2-2,2 (column,row); may be repeated."),
    ] = None,
    remove_share: Annotated[
        float, typer.Option(min=0, max=0.9, help="Leave out this share of the inner roads.")
    ] = 0.0,
    vehicles_per_hour: Annotated[
        float, typer.Option(help="That enter the whole network, mean over the horizon.")
    ] = 3000.0,
    course: Annotated[
        str, typer.Option(help="Of the demand over time: constant, peak, ramp or gaussian.")
    ] = "constant",
    turns: Annotated[
        str, typer.Option(help="Shares of left, straight, right at an intersection.")
    ] = "0.1,0.6,0.3",
    through: Annotated[float, typer.Option(help="Share of the vehicles that never turn.")] = 0.0,
    horizon: Annotated[int, typer.Option(min=1, help="Seconds of demand.")] = 3600,
    seed: Annotated[int, typer.Option(min=0, help="Of demand and removed roads.")] = 0,
    as_name: Annotated[
        str | None, typer.Option("--as", help="A name to keep it under, for tsc-run --net NAME.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="A new folder to write it to, for tsc-run --net DIR.")
    ] = None,
) -> None:
    """Generate a grid of intersections with demand; the same options give the same bytes."""
    from tsc_missing.network.generating import (
        Recipe,
        generate_network,
        read_lanes,
        read_removed,
    )

    target, name, field = find_target(as_name, out)
    grid = _grid(
        rows=rows,
        columns=columns,
        east_west=east_west,
        north_south=north_south,
        lanes=read_lanes(lanes, "--lanes"),
        side_lanes=read_lanes(side_lanes, "--side-lanes") if side_lanes is not None else None,
        speed=speed,
        side_speed=side_speed,
    )
    grid = grid.model_copy(update={"removed": read_removed(grid, remove or (), remove_share, seed)})
    demand = demand_spec(
        vehicles_per_hour=vehicles_per_hour,
        course=course,
        turns=_shares(turns),
        through=through,
    )
    recipe = Recipe(grid, demand, float(horizon), seed, _command(context))
    say_written(generate_network(recipe, target, name, field), target)


def _grid(**values: Any) -> GridSpec:
    try:
        spec = GridSpec.model_validate(values)
    except ValidationError as error:
        raise option_error(error) from None
    shortest = 2 * spec.stop_distance
    for length in ("east_west", "north_south"):
        if values[length] <= shortest:
            raise UserError(
                f"--{length.replace('_', '-')}", values[length], f"more than {shortest:g} m"
            )
    return spec


def _shares(text: str) -> tuple[float, ...]:
    try:
        left, straight, right = map(float, text.split(","))
    except ValueError:
        raise UserError("--turns", text, "three numbers: left,straight,right") from None
    return left, straight, right


def _command(context: typer.Context) -> str:
    """The command line that makes the network, without the place it is written to."""
    words = ["tsc-net generate"]
    for option in context.command.params:
        name, value = option.name or "", context.params.get(option.name or "")
        if name not in ("as_name", "out") and value not in (None, [], ()):
            values = value if isinstance(value, (list, tuple)) else [value]
            words += [f"{option.opts[0]} {item}" for item in values]
    return " ".join(words)
