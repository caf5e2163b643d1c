"""Rectangular grids of signalised intersections, from a few numbers.

Names are CityFlow's: ``intersection_c_r`` is in column c from the west and row r from the south,
both from 1; ``road_c_r_d`` leaves it to the east, north, west or south (d = 0 to 3). Column or
row 0 and the one past the last are boundary nodes without signals, where traffic enters and
leaves.
"""

import tomllib
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from tsc_missing.errors import UserError
from tsc_missing.files import parse
from tsc_missing.network.plain import Lane, Movement, Node, Phase, PlainNetwork, Point, Road
from tsc_missing.network.slots import LEFT, RIGHT, STRAIGHT, TURNS

FIELD = "grid"
EAST, NORTH, WEST, SOUTH = range(4)  # headings of roads
STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))  # columns, rows
HEADING_AFTER = {LEFT: 1, STRAIGHT: 0, RIGHT: 3}  # added to the heading, modulo 4
PHASES = (
    ("WT_ET", (EAST, WEST), STRAIGHT),
    ("NT_ST", (SOUTH, NORTH), STRAIGHT),
    ("WL_EL", (EAST, WEST), LEFT),
    ("NL_SL", (SOUTH, NORTH), LEFT),
)  # each with the headings of the approaching traffic and its turn

Metres = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Turn = Literal["left", "straight", "right"]
Cell = tuple[int, int]  # column, row


class GridSpec(BaseModel):
    """What ``networks/*/grid.toml`` holds."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    rows: int = Field(gt=0)
    columns: int = Field(gt=0)
    east_west: Metres  # [m] between columns, and from the outer ones to the boundary
    north_south: Metres  # [m] between rows
    lanes: tuple[tuple[Turn, ...], ...] = Field(
        (("left",), ("straight",), ("right",)), min_length=1
    )  # the turns made from each lane, from the middle of the road outward
    lane_width: Metres = 4.0  # [m]
    speed: Metres = 11.111  # [m/s]
    stop_distance: Metres = 15.0  # [m] from an intersection's centre to its stop lines


_ADAPTER = TypeAdapter(GridSpec)


def read_grid(path: Path) -> GridSpec:
    """The specification in a TOML file; raises ``UserError`` with the place of what is wrong."""
    try:
        value = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UserError(FIELD, path, f"the file cannot be read ({error.strerror})") from None
    except ValueError as error:
        raise UserError(FIELD, path, f"not valid TOML ({error})") from None
    return parse(_ADAPTER, value, FIELD, path)


def build_grid(spec: GridSpec) -> PlainNetwork:
    """The network of a specification.

    Every lane leads to all lanes of the roads that its turns go to; right turns are free.
    """
    cells = [
        (column, row)
        for column in range(spec.columns + 2)
        for row in range(spec.rows + 2)
        if _signalised(spec, (column, row)) or _on_boundary(spec, (column, row))
    ]
    roads = [
        _road(spec, cell, heading)
        for cell in cells
        for heading in range(4)
        if _has_road(spec, cell, heading)
    ]
    return PlainNetwork(
        nodes={_node_name(cell): _node(spec, cell) for cell in cells},
        roads={road.id: road for road in roads},
    )


def _signalised(spec: GridSpec, cell: Cell) -> bool:
    return 1 <= cell[0] <= spec.columns and 1 <= cell[1] <= spec.rows


def _on_boundary(spec: GridSpec, cell: Cell) -> bool:
    return any(_signalised(spec, _beside(cell, heading)) for heading in range(4))


def _has_road(spec: GridSpec, cell: Cell, heading: int) -> bool:
    return _signalised(spec, cell) or _signalised(spec, _beside(cell, heading))


def _beside(cell: Cell, heading: int) -> Cell:
    return cell[0] + STEPS[heading][0], cell[1] + STEPS[heading][1]


def _node_name(cell: Cell) -> str:
    return f"intersection_{cell[0]}_{cell[1]}"


def _road_name(cell: Cell, heading: int) -> str:
    return f"road_{cell[0]}_{cell[1]}_{heading}"


def _point(spec: GridSpec, cell: Cell) -> Point:
    return (cell[0] - 1) * spec.east_west, (cell[1] - 1) * spec.north_south


def _road(spec: GridSpec, cell: Cell, heading: int) -> Road:
    end = _beside(cell, heading)
    return Road(
        id=_road_name(cell, heading),
        start=_node_name(cell),
        end=_node_name(end),
        lanes=(Lane(width=spec.lane_width, speed=spec.speed),) * len(spec.lanes),
        shape=(_point(spec, cell), _point(spec, end)),
    )


def _node(spec: GridSpec, cell: Cell) -> Node:
    x, y = _point(spec, cell)
    if not _signalised(spec, cell):
        return Node(id=_node_name(cell), x=x, y=y)
    made = [
        (heading, turn)
        for heading in range(4)
        for turn in (LEFT, STRAIGHT, RIGHT)
        if _lanes_of(spec, turn)
    ]
    phases = [
        Phase(name, tuple(made.index((heading, turn)) for heading in headings))
        for name, headings, turn in PHASES
        if _lanes_of(spec, turn)
    ]
    return Node(
        id=_node_name(cell),
        x=x,
        y=y,
        movements=tuple(_movement(spec, cell, heading, turn) for heading, turn in made),
        phases=tuple(phases),
        free=tuple(number for number, (_, turn) in enumerate(made) if turn == RIGHT),
        stop_distance=spec.stop_distance,
    )


def _movement(spec: GridSpec, cell: Cell, heading: int, turn: int) -> Movement:
    before = _beside(cell, (heading + 2) % 4)
    return Movement(
        from_road=_road_name(before, heading),
        to_road=_road_name(cell, (heading + HEADING_AFTER[turn]) % 4),
        turn=turn,
        lane_pairs=tuple(
            (start, end) for start in _lanes_of(spec, turn) for end in range(len(spec.lanes))
        ),
    )


def _lanes_of(spec: GridSpec, turn: int) -> list[int]:
    """The lanes that a turn is made from, counted from the right."""
    outward = [TURNS[turn] in turns for turns in reversed(spec.lanes)]
    return [lane for lane, made in enumerate(outward) if made]
