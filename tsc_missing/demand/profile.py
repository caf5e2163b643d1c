"""Demand profiles: statistics of a demand, and the drawing of trips from them.

A profile says how many vehicles enter by each road in each time bin, how evenly they come, and
how large a share of the traffic turns left, goes straight and turns right. A drawn vehicle walks
from its entry road on by those shares until it leaves the network.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, model_validator

from tsc_missing.demand.trips import Demand, Trip
from tsc_missing.errors import UserError
from tsc_missing.files import parse, read_json
from tsc_missing.network.plain import PlainNetwork
from tsc_missing.network.records import NetworkRecord
from tsc_missing.network.slots import TURNS
from tsc_missing.seeding import stream

FIELD = "demand"

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

Rate = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Shares = tuple[Rate, Rate, Rate]  # left, straight, right; used relative to their sum
Turns = Mapping[str, Mapping[str, int]]  # for each road the turns (slots.LEFT, …) to next roads


class DemandProfile(BaseModel):
    """What ``scenarios/demand/*.json`` holds."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal[1] = 1
    bin: int = Field(gt=0)  # [s]
    irregularity: float = Field(ge=0, le=1)  # of the headways in a bin: 0 all equal, 1 random
    repeats: Literal["end", "avoid"]  # what a walk does about a road it has already used
    turns: Shares  # of the network
    road_turns: dict[str, Shares]  # of the roads that differ from the network
    arrivals: dict[str, tuple[Rate, ...]]  # [vehicles] by entry road, in each bin from 0 s on

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if len({len(row) for row in self.arrivals.values()}) != 1:
            raise ValueError("arrivals must have the same number of bins (at least one) a road")
        if not all(sum(shares) > 0 for shares in (self.turns, *self.road_turns.values())):
            raise ValueError("the turn shares of a road must not all be 0")
        return self


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
    down at random. Raises ``UserError`` for an entry road that leads nowhere.
    """
    for road in profile.arrivals:
        if road not in turns:
            raise UserError(
                FIELD, road, "an entry road must be a road of the network that leads on"
            )
    rng = stream(seed, "demand")
    entries, departs = _draw_arrivals(profile, rng, volume)
    within = departs < horizon
    graph = _Graph.of(profile, turns)
    start = np.array([graph.index[road] for road in profile.arrivals], dtype=np.int64)
    routes = _walk(graph, start[entries[within]], profile.repeats == "avoid", rng)
    return Demand.of(map(Trip, departs[within].tolist(), routes), "profile")


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


@dataclass(frozen=True)
class _Graph:
    """R roads with up to K next roads each."""

    roads: tuple[str, ...]
    index: Mapping[str, int]
    following: IntArray  # (R, K), -1 for none
    shares: FloatArray  # (R, K)

    @classmethod
    def of(cls, profile: DemandProfile, turns: Turns) -> Self:
        """Next roads of the same turn share its traffic equally."""
        roads = tuple(sorted({*turns, *(road for row in turns.values() for road in row)}))
        index = {road: number for number, road in enumerate(roads)}
        following = np.full((len(roads), max(map(len, turns.values()))), -1, dtype=np.int64)
        shares = np.zeros(following.shape)
        for road, row in turns.items():
            wanted, made = profile.road_turns.get(road, profile.turns), list(row.values())
            following[index[road], : len(row)] = [index[target] for target in row]
            shares[index[road], : len(row)] = [wanted[t] / made.count(t) for t in made]
        return cls(roads, index, following, shares)


def _walk(
    graph: _Graph, start: IntArray, avoid: bool, rng: np.random.Generator
) -> list[tuple[str, ...]]:
    """The routes of vehicles that enter by the roads ``start`` (V,).

    A walk ends where there is no way on, and no road comes twice in it: with ``avoid`` a road
    that was used is no option any more, without it the walk ends before it.
    """
    path = start[:, None]  # (V, steps so far), -1 after the end
    active = np.arange(start.size)
    while active.size:
        past = path[active]
        options, chances = graph.following[past[:, -1]], graph.shares[past[:, -1]]
        used = (options[:, :, None] == past[:, None, :]).any(axis=2)
        if avoid:
            chances = np.where(used, 0.0, chances)
        bounds = chances.cumsum(axis=1)
        drawn = rng.random(active.size) * bounds[:, -1]
        choice = (drawn[:, None] >= bounds[:, :-1]).sum(axis=1)
        rows = np.arange(active.size)
        going = (bounds[:, -1] > 0) & ~used[rows, choice]
        active = active[going]
        column = np.full(start.size, -1, dtype=np.int64)
        column[active] = options[rows, choice][going]
        path = np.column_stack((path, column))
    lengths = (path >= 0).sum(axis=1).tolist()
    names = np.array(graph.roads, dtype=object)[path].tolist()
    return [tuple(row[:length]) for row, length in zip(names, lengths, strict=True)]
