"""Grids from specifications: the recorded networks, and grids of other shapes."""

import itertools
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tests.shared import CITYFLOW, needs_shared
from tsc_missing.errors import UserError
from tsc_missing.network.cityflow import read_roadnet
from tsc_missing.network.generating import read_removed
from tsc_missing.network.grid import GridSpec, build_grid, grid_roads, is_inside, read_grid
from tsc_missing.network.plain import Node
from tsc_missing.network.slots import LEFT, RIGHT, STRAIGHT

NETWORKS = Path(__file__).resolve().parents[2] / "networks"
RECORDED = {"hangzhou": "roadnet_4_4", "jinan": "roadnet_3_4", "newyork": "roadnet_16_3"}
HEADINGS = {0: (1, 0), 1: (0, 1), 2: (-1, 0), 3: (0, -1)}


def spec(**changes) -> GridSpec:
    return GridSpec(
        **{"rows": 2, "columns": 3, "east_west": 300.0, "north_south": 200.0, **changes}
    )


def unordered(node: Node):
    """What a node is, whatever the order of its movements and the names of its phases."""
    moves = node.movements
    return (
        replace(node, movements=(), phases=(), free=()),
        frozenset(moves),
        [frozenset(moves[m] for m in phase.movements) for phase in node.phases],
        frozenset(moves[m] for m in node.free),
    )


@needs_shared
@pytest.mark.parametrize("city", RECORDED)
def test_specifications_give_the_recorded_networks(city):
    built = build_grid(read_grid(NETWORKS / city / "grid.toml"))
    recorded = read_roadnet(CITYFLOW / f"{RECORDED[city]}.json")
    assert built.roads == recorded.roads
    assert {name: unordered(node) for name, node in built.nodes.items()} == {
        name: unordered(node) for name, node in recorded.nodes.items()
    }


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (1, 4), (5, 2), (3, 3)])
def test_counts(rows, columns):
    grid = build_grid(spec(rows=rows, columns=columns))
    signalised = [node for node in grid.nodes.values() if node.signalised]
    assert len(signalised) == rows * columns
    assert len(grid.nodes) == rows * columns + 2 * (rows + columns)
    assert len(grid.roads) == 2 * (rows * (columns + 1) + columns * (rows + 1))
    assert all(len(node.movements) == 12 and len(node.phases) == 4 for node in signalised)


def test_roads_join_neighbours_at_the_given_spacing():
    grid = build_grid(spec())
    for road in grid.roads.values():
        column, row, heading = map(int, road.id.split("_")[1:])
        step = HEADINGS[heading]
        assert road.start == f"intersection_{column}_{row}"
        assert road.end == f"intersection_{column + step[0]}_{row + step[1]}"
        (x, y), (end_x, end_y) = road.shape
        assert (end_x - x, end_y - y) == (300.0 * step[0], 200.0 * step[1])
        assert (x, y) == (grid.nodes[road.start].x, grid.nodes[road.start].y)


def test_movements_turn_the_way_they_say():
    change = {STRAIGHT: 0, LEFT: 1, RIGHT: 3}
    grid = build_grid(spec())
    for node in grid.nodes.values():
        for move in node.movements:
            before, after = (int(road[-1]) for road in (move.from_road, move.to_road))
            assert (after - before) % 4 == change[move.turn]
            assert grid.roads[move.from_road].end == node.id == grid.roads[move.to_road].start


def test_phases_serve_opposite_approaches_and_right_turns_are_free():
    node = build_grid(spec()).nodes["intersection_2_1"]
    served = {
        phase.name: {(node.movements[m].from_road, node.movements[m].turn) for m in phase.movements}
        for phase in node.phases
    }
    west, south, east, north = "road_1_1_0", "road_2_0_1", "road_3_1_2", "road_2_2_3"
    assert served == {
        "WT_ET": {(west, STRAIGHT), (east, STRAIGHT)},
        "NT_ST": {(north, STRAIGHT), (south, STRAIGHT)},
        "WL_EL": {(west, LEFT), (east, LEFT)},
        "NL_SL": {(north, LEFT), (south, LEFT)},
    }
    assert list(served) == ["WT_ET", "NT_ST", "WL_EL", "NL_SL"]
    assert {(node.movements[m].from_road, node.movements[m].turn) for m in node.free} == {
        (road, RIGHT) for road in (west, south, east, north)
    }


def test_lanes_are_counted_from_the_middle_of_the_road():
    grid = build_grid(spec(lanes=(("left",), ("straight", "right")), lane_width=3.2, speed=8.0))
    lanes_of = {move.turn: move.lane_pairs for move in grid.nodes["intersection_1_1"].movements}
    assert lanes_of == {
        LEFT: ((1, 0), (1, 1)),
        STRAIGHT: ((0, 0), (0, 1)),
        RIGHT: ((0, 0), (0, 1)),
    }
    assert {lane for road in grid.roads.values() for lane in road.lanes} == {
        grid.roads["road_1_1_0"].lanes[0]
    }
    assert (grid.roads["road_1_1_0"].lanes[0].width, grid.roads["road_1_1_0"].lanes[0].speed) == (
        3.2,
        8.0,
    )


def test_a_turn_without_a_lane_is_not_there():
    node = build_grid(spec(lanes=(("straight",), ("right",)))).nodes["intersection_1_1"]
    assert {move.turn for move in node.movements} == {STRAIGHT, RIGHT}
    assert [phase.name for phase in node.phases] == ["WT_ET", "NT_ST"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("rows = 0\ncolumns = 1\neast_west = 9\nnorth_south = 9", "at rows"),
        ("rows = 1\ncolumns = 1\neast_west = 9", "at north_south"),
        ("rows = 1\ncolumns = 1\neast_west = 9\nnorth_south = 9\nheight = 3", "at height"),
        ("rows = ", "not valid TOML"),
    ],
)
def test_what_is_wrong_with_a_file_is_named(tmp_path, text, words):
    path = tmp_path / "grid.toml"
    path.write_text(text)
    with pytest.raises(UserError, match=words):
        read_grid(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(UserError, match=r"grid\.toml.*cannot be read"):
        read_grid(tmp_path / "grid.toml")


@settings(max_examples=60, deadline=None)
@given(
    rows=st.integers(1, 4),
    columns=st.integers(1, 4),
    share=st.floats(0, 0.9),
    seed=st.integers(0, 2**31),
)
def test_roads_that_are_left_out_at_random_leave_no_dead_end(rows, columns, share, seed):
    grid = spec(rows=rows, columns=columns)
    try:
        removed = read_removed(grid, (), share, seed)
    except UserError:
        assume(False)
    inner = [p for p in grid_roads(grid) if all(is_inside(grid, cell) for cell in p)]
    assert set(removed) <= set(inner)
    assert len(removed) <= round(share * len(inner))
    left = grid_roads(grid.model_copy(update={"removed": removed}))
    for cell in itertools.product(range(1, columns + 1), range(1, rows + 1)):
        assert sum(cell in pair for pair in left) >= 2
