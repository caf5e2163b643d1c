"""Grids with demand from a few numbers, as network folders."""

import itertools
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tsc_missing.config import VehicleType
from tsc_missing.demand.generate import (
    DemandSpec,
    arrivals_by_road,
    entry_warnings,
    generate_on_grid,
    too_few,
)
from tsc_missing.demand.profile import plain_turns
from tsc_missing.demand.trips import write_routes
from tsc_missing.errors import UserError
from tsc_missing.files import whole_folder
from tsc_missing.network.folder import (
    NET,
    RECORD,
    ROUTES,
    Manifest,
    builder_versions,
    check_dataset,
    write_manifest,
)
from tsc_missing.network.grid import Cell, GridSpec, build_grid, grid_roads, is_inside
from tsc_missing.network.netconvert import write_net
from tsc_missing.network.plain import PlainNetwork
from tsc_missing.network.records import write_record
from tsc_missing.network.slots import TURNS
from tsc_missing.network.sumo import compile_sumo, open_net
from tsc_missing.seeding import stream

LETTERS = {turn[0]: turn for turn in TURNS}  # of lanes in words: "l", "s", "r"
PAIR = re.compile(r"(\d+),(\d+)-(\d+),(\d+)")


@dataclass(frozen=True)
class Recipe:
    """A generated network: its grid, its demand, and the command line that makes it."""

    grid: GridSpec
    demand: DemandSpec
    horizon: float  # [s]
    seed: int
    command: str


def generate_network(recipe: Recipe, target: Path, name: str, field: str) -> Manifest:
    """Write a network folder; the same recipe and versions give the same bytes.

    ``field`` names ``target`` in errors. The manifest's notes say where demand cannot enter.
    """
    plain = build_grid(recipe.grid)
    if not any(node.signalised for node in plain.nodes.values()):
        lanes = ",".join("".join(turn[0] for turn in lane) for lane in recipe.grid.lanes)
        raise UserError("lanes", lanes, "right turns alone need no signals")
    entries = {
        road.id: float(len(road.lanes))
        for road in plain.roads.values()
        if not plain.nodes[road.start].movements
    }
    demand = generate_on_grid(
        plain_turns(plain), entries, recipe.demand, recipe.horizon, recipe.seed
    )
    if not demand.trips:
        raise too_few(recipe.demand, recipe.horizon)
    with whole_folder(target, field) as folder:
        write_net(plain, folder / NET)
        source = open_net(folder / NET)
        record = compile_sumo(source, near_side_free=True)
        check_dataset(target, name, record, field)
        write_record(record, folder / RECORD)
        write_routes(demand, VehicleType(), folder / ROUTES)
        notes = [*_warnings(plain, entries, recipe), *source.notes]
        manifest = Manifest(
            name=name,
            kind="generated",
            intersections=len(record.intersections),
            vehicles=len(demand.trips),
            demand="generated",
            horizon=recipe.horizon,
            recipe=recipe.command,
            notes=tuple(notes) or None,
            versions=builder_versions(),
        )
        write_manifest(folder, manifest)
    return manifest


def _warnings(plain: PlainNetwork, entries: dict[str, float], recipe: Recipe) -> list[str]:
    speeds = {road: [lane.speed for lane in plain.roads[road].lanes] for road in entries}
    arrivals = arrivals_by_road(recipe.demand, entries, recipe.horizon)
    return [f"warning: {w}" for w in entry_warnings(arrivals, speeds, VehicleType())]


def read_lanes(text: str, field: str) -> tuple[tuple[str, ...], ...]:
    """Lanes from their number, or from letters: ``l,s,sr`` from the middle of the road outward."""
    if text.isdigit() and 1 <= int(text) <= 8:
        count = int(text)
        if count == 1:
            return (TURNS,)
        if count == 2:
            return (TURNS[:2], TURNS[1:])
        return (TURNS[:1], *[TURNS[1:2]] * (count - 2), TURNS[2:])
    lanes = text.split(",")
    if len(lanes) > 8 or not all(lane and set(lane) <= set(LETTERS) for lane in lanes):
        raise UserError(field, text, "the number of lanes, 1 to 8, or each lane's turns, as l,s,sr")
    turns = [sorted({TURNS.index(LETTERS[letter]) for letter in lane}) for lane in lanes]
    if any(first[-1] > second[0] for first, second in itertools.pairwise(turns)):
        raise UserError(field, text, "turns would cross: lanes go from left to right, as l,s,sr")
    return tuple(tuple(TURNS[turn] for turn in lane) for lane in turns)


def read_removed(
    spec: GridSpec, pairs: Sequence[str], share: float, seed: int
) -> tuple[tuple[Cell, Cell], ...]:
    """Missing roads: those named as ``1,2-2,2`` (column,row), and a share of the inner ones.

    Of the drawn ones none leaves an intersection with fewer than two roads, so they may be fewer.
    Raises ``UserError`` where no intersection keeps three, which signals need.
    """
    there = grid_roads(spec)
    removed = []
    for text in pairs:
        match = PAIR.fullmatch(text)
        a, b, c, d = map(int, match.groups()) if match else (-1, -1, -1, -1)
        pair = min((a, b), (c, d)), max((a, b), (c, d))
        if pair not in there:
            raise UserError(
                "remove", text, "two neighbours of the grid as COLUMN,ROW-COLUMN,ROW, each from 1"
            )
        removed.append(pair)
    inner = [p for p in there if p not in removed and all(is_inside(spec, cell) for cell in p)]
    arms = Counter(cell for pair in there if pair not in removed for cell in pair)
    _check_arms(arms, "remove", " ".join(pairs))
    left = round(share * len(inner))
    for k in stream(seed, "roads").permutation(len(inner)):
        if left and all(arms[cell] > 2 for cell in inner[k]):
            removed.append(inner[k])
            arms.subtract(inner[k])
            left -= 1
    _check_arms(arms, "remove-share", share)
    return tuple(dict.fromkeys(removed))


def _check_arms(arms: Mapping[Cell, int], field: str, value: object) -> None:
    if max(arms.values(), default=0) < 3:
        raise UserError(field, value, "no intersection keeps three roads, so no signals")
