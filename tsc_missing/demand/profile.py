"""Demand profiles: statistics of a demand, and the drawing of trips from them.

A profile says how many vehicles enter by each road in each time bin, how evenly they come, and
how large a share of the traffic turns left, goes straight and turns right. Without ``exits`` a
drawn vehicle walks on by those shares until it leaves the network. With them it draws the road
that it leaves by and takes a shortest way there, and the shares choose among equal ways.
"""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, model_validator

from tsc_missing.demand.routing import (
    FAR,
    FloatArray,
    IntArray,
    RoadGraph,
    Route,
    Turns,
    draw_columns,
    shortest_paths,
    walk,
)
from tsc_missing.demand.trips import Demand, Trip
from tsc_missing.errors import UserError
from tsc_missing.files import parse, read_json
from tsc_missing.network.plain import PlainNetwork
from tsc_missing.network.records import NetworkRecord
from tsc_missing.network.slots import TURNS
from tsc_missing.seeding import stream

FIELD = "demand"

Rate = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Shares = tuple[Rate, Rate, Rate]  # left, straight, right; used relative to their sum


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class ExitShares(_Part):
    """The exit roads' shares of what enters by a group of roads; used relative to their sum."""

    entries: tuple[str, ...] = Field(min_length=1)
    exits: dict[str, Rate]


class DemandProfile(_Part):
    """What ``scenarios/demand/*.json`` holds."""

    format: Literal[1] = 1
    bin: int = Field(gt=0)  # [s]
    irregularity: float = Field(ge=0, le=1)  # of the headways in a bin: 0 all equal, 1 random
    turns: Shares  # of the network
    road_turns: dict[str, Shares]  # of the roads that differ from the network
    exits: tuple[ExitShares, ...]  # for all entry roads, or none
    arrivals: dict[str, tuple[Rate, ...]]  # [vehicles] by entry road, in each bin from 0 s on

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if len({len(row) for row in self.arrivals.values()}) != 1:
            raise ValueError("arrivals must have the same number of bins (at least one) a road")
        if not all(sum(shares) > 0 for shares in (self.turns, *self.road_turns.values())):
            raise ValueError("the turn shares of a road must not all be 0")
        grouped = sorted(road for group in self.exits for road in group.entries)
        if grouped and grouped != sorted(self.arrivals):
            raise ValueError("each road in arrivals must be in one group of exits, or none in any")
        return self

    @property
    def duration(self) -> float:
        """How long vehicles arrive [s]."""
        return float(self.bin * len(next(iter(self.arrivals.values()))))

    def graph(self, turns: Turns) -> RoadGraph:
        """The roads of a network with the profile's turn shares."""
        return RoadGraph.of(turns, lambda road: self.road_turns.get(road, self.turns))


_ADAPTER = TypeAdapter(DemandProfile)


def read_profile(path: Path) -> DemandProfile:
    """The profile in a file; raises ``UserError`` with the place of what is wrong."""
    return parse(_ADAPTER, read_json(path, FIELD), FIELD, path)


def plain_turns(plain: PlainNetwork) -> dict[str, dict[str, int]]:
    """The turns that a plain network's movements make."""
    turns: dict[str, dict[str, int]] = {}
    for node in plain.nodes.values():
        for move in node.movements:
            turns.setdefault(move.from_road, {})[move.to_road] = move.turn
    return turns


def record_turns(record: NetworkRecord) -> dict[str, dict[str, int]]:
    """The turns at the signalised intersections of a compiled network."""
    turns: dict[str, dict[str, int]] = {}
    for node in record.intersections:
        for link in node.links:
            start, end = (record.lanes[lane].road for lane in (link.from_lane, link.to_lane))
            turns.setdefault(start, {})[end] = link.slot % len(TURNS)
    return turns


def draw_demand(
    profile: DemandProfile, turns: Turns, seed: int, volume: float, horizon: float
) -> Demand:
    """Trips that depart before ``horizon`` [s], at whole seconds; ``volume`` scales the arrivals.

    The number that enters by a road in a bin is the profile's times ``volume``, rounded up or
    down at random. Raises ``UserError`` for roads of the profile that the network lacks.
    """
    rng = stream(seed, "demand")
    graph = profile.graph(turns)
    _check_roads(profile, turns, graph)
    entries = graph.numbers(list(profile.arrivals))
    entry, departs = _draw_arrivals(profile, rng, volume)
    within = departs < horizon
    entry, departs = entry[within], departs[within]
    if profile.exits:
        routes = _routes_to_exits(profile, graph, entries, entry, rng)
    else:
        routes = walk(graph, entries[entry], rng)
    demand = Demand.of(map(Trip, departs.tolist(), routes))
    return replace(demand, duration=profile.duration)


def _check_roads(profile: DemandProfile, turns: Turns, graph: RoadGraph) -> None:
    for road in profile.arrivals:
        if not turns.get(road):
            raise UserError(FIELD, road, "an entry road must lead on to other roads")
    for group in profile.exits:
        for road in group.exits:
            if road not in graph.index:
                raise UserError(FIELD, road, "an exit road must be a road of the network")


def _draw_arrivals(
    profile: DemandProfile, rng: np.random.Generator, volume: float
) -> tuple[IntArray, FloatArray]:
    """For each vehicle its entry road's position in the profile and its departure [s].

    A position in the bin lies between an even spacing with a random offset and the order
    statistics of as many uniform numbers, so that ``irregularity`` is the headways' coefficient
    of variation.
    """
    expected = np.array(list(profile.arrivals.values())) * volume
    counts = np.floor(expected + rng.random(expected.shape)).astype(np.int64).ravel()
    cell = np.repeat(np.arange(counts.size), counts)
    rank = np.arange(cell.size) - np.repeat(np.cumsum(counts) - counts, counts)
    even = (rank + rng.random(counts.size)[cell]) / counts[cell]
    uniform = rng.random(cell.size)
    uniform = uniform[np.lexsort((uniform, cell))]
    position = even + profile.irregularity * (uniform - even)
    entry, number = np.divmod(cell, expected.shape[1])
    return entry, np.floor(profile.bin * (number + position))


def _routes_to_exits(
    profile: DemandProfile,
    graph: RoadGraph,
    entries: IntArray,
    entry: IntArray,
    rng: np.random.Generator,
) -> list[Route]:
    """Routes of vehicles that enter by ``entries[entry]``, each to an exit drawn for it."""
    names = sorted({road for group in profile.exits for road in group.exits})
    exits = graph.numbers(names)
    group_of = {road: group.exits for group in profile.exits for road in group.entries}
    weights = np.array([[group_of[e].get(x, 0.0) for x in names] for e in profile.arrivals])
    weights = weights * possible_exits(graph, entries, exits)
    for road, row in zip(profile.arrivals, weights, strict=True):
        if not row.any():
            raise UserError(FIELD, road, "the profile's exits for it must be roads it can reach")
    return shortest_paths(graph, entries[entry], exits, draw_columns(weights[entry], rng), rng)


def possible_exits(graph: RoadGraph, entries: IntArray, exits: IntArray) -> FloatArray:
    """(E, X), 0 or 1: exits that can be reached other than by turning back where one entered."""
    reached = graph.distances(exits)[entries] < FAR
    return (reached & ~graph.reversals(entries, exits)).astype(np.float64)
