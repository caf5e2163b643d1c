"""Rectangular grids of signalised intersections, from a few numbers.

Names are CityFlow's: ``intersection_c_r`` is in column c from the west and row r from the south,
both from 1; ``road_c_r_d`` leaves it to the east, north, west or south (d = 0 to 3). Column or
row 0 and the one past the last are boundary nodes without signals, where traffic enters and
leaves. Roads may be missing: an intersection that keeps two roads has no signals, and one that
keeps a single road is a dead end, where traffic enters and leaves too.
"""

import tomllib
from collections.abc import Sequence
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

Metres = Annotated[float, Field(gt=0, le=20_000, allow_inf_nan=False)]
Speed = Annotated[float, Field(ge=1, le=70, allow_inf_nan=False)]  # [m/s]
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
    speed: Speed = 11.111  # [m/s]
    stop_distance: Metres = 15.0  # [m] from an intersection's centre to its stop lines
    side_lanes: tuple[tuple[Turn, ...], ...] | None = None  # of north-south roads, if they differ
    side_speed: Speed | None = None  # [m/s] on north-south roads, if it differs
    removed: tuple[tuple[Cell, Cell], ...] = ()  # pairs of neighbours without a road between them

    def lanes_along(self, heading: int) -> tuple[tuple[Turn, ...], ...]:
        """The lanes of roads that head so."""
        return self.side_lanes if self.side_lanes and heading % 2 else self.lanes

    def speed_along(self, heading: int) -> float:
        """The speed limit of roads that head so [m/s]."""
        return self.side_speed if self.side_speed and heading % 2 else self.speed


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

    A turn leads to all lanes of the road that it goes to; right turns are free.
    """
    cells = [
        (column, row)
        for column in range(spec.columns + 2)
        for row in range(spec.rows + 2)
        if _arms(spec, (column, row))
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


def is_inside(spec: GridSpec, cell: Cell) -> bool:
    """Whether a cell is one of the grid's, and not on its boundary."""
    return 1 <= cell[0] <= spec.columns and 1 <= cell[1] <= spec.rows


def grid_roads(spec: GridSpec) -> list[tuple[Cell, Cell]]:
    """The pairs of neighbours with a road between them, each once."""
    cells = [(c, r) for c in range(spec.columns + 2) for r in range(spec.rows + 2)]
    return [
        (cell, _beside(cell, heading))
        for cell in cells
        for heading in (EAST, NORTH)
        if _has_road(spec, cell, heading)
    ]


def _has_road(spec: GridSpec, cell: Cell, heading: int) -> bool:
    other = _beside(cell, heading)
    there = is_inside(spec, cell) or is_inside(spec, other)
    return there and not {(cell, other), (other, cell)} & set(spec.removed)


def _arms(spec: GridSpec, cell: Cell) -> list[int]:
    """The headings of the roads that leave a cell."""
    return [heading for heading in range(4) if _has_road(spec, cell, heading)]


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
        lanes=(Lane(width=spec.lane_width, speed=spec.speed_along(heading)),)
        * len(spec.lanes_along(heading)),
        shape=(_point(spec, cell), _point(spec, end)),
    )


def _node(spec: GridSpec, cell: Cell) -> Node:
    x, y = _point(spec, cell)
    arms = _arms(spec, cell)
    if not is_inside(spec, cell) or len(arms) < 2:
        return Node(id=_node_name(cell), x=x, y=y)
    made = [
        (heading, turn)
        for heading in range(4)
        for turn in (LEFT, STRAIGHT, RIGHT)
        if _lanes_of(spec, cell, heading, turn)
    ]
    phases = [
        Phase(name, tuple(made.index((h, turn)) for h in headings if (h, turn) in made))
        for name, headings, turn in PHASES
        if len(arms) > 2 and any((h, turn) in made for h in headings)
    ]
    return Node(
        id=_node_name(cell),
        x=x,
        y=y,
        movements=tuple(_movement(spec, cell, heading, turn) for heading, turn in made),
        phases=tuple(phases),
        free=tuple(n for n, (_, turn) in enumerate(made) if turn == RIGHT and len(arms) > 2),
        stop_distance=spec.stop_distance,
    )


def _movement(spec: GridSpec, cell: Cell, heading: int, turn: int) -> Movement:
    before, after = _beside(cell, (heading + 2) % 4), (heading + HEADING_AFTER[turn]) % 4
    return Movement(
        from_road=_road_name(before, heading),
        to_road=_road_name(cell, after),
        turn=turn,
        lane_pairs=_side_by_side(
            _lanes_of(spec, cell, heading, turn), len(spec.lanes_along(after))
        ),
    )


def _side_by_side(starts: Sequence[int], exits: int) -> tuple[tuple[int, int], ...]:
    """Every lane of a turn to its part of the exit road's lanes; a single lane to all of them."""
    count = len(starts)
    return tuple(
        (start, end)
        for k, start in enumerate(starts)
        for end in range(exits)
        if end == k * exits // count or k * exits // count <= end < (k + 1) * exits // count
    )


def _lanes_of(spec: GridSpec, cell: Cell, heading: int, turn: int) -> list[int]:
    """The lanes of the road to a cell that a turn is made from, counted from the right.

    A lane none of whose turns is there, because roads are missing, makes the nearest that is.
    """
    arms = _arms(spec, cell)
    if (heading + 2) % 4 not in arms:
        return []
    open_ = [t for t in (LEFT, STRAIGHT, RIGHT) if (heading + HEADING_AFTER[t]) % 4 in arms]
    found = []
    for lane, turns in enumerate(reversed(spec.lanes_along(heading))):
        wanted = [TURNS.index(name) for name in turns]
        possible = [t for t in wanted if t in open_]
        made = possible or sorted(open_, key=lambda t: min(abs(t - w) for w in wanted))[:1]
        if turn in made:
            found.append(lane)
    return found
