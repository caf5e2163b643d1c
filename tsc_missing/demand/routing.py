"""Drawing routes on a graph of roads: walks by turn shares, and shortest paths to drawn exits."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

BoolArray = npt.NDArray[np.bool_]
FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

Turns = Mapping[str, Mapping[str, int]]  # for each road the turns (slots.LEFT, …) to next roads
Route = tuple[str, ...]

NONE = -1
FAR = np.iinfo(np.int64).max // 2


@dataclass(frozen=True)
class RoadGraph:
    """R roads with up to K next roads each, and the share of its traffic that takes them."""

    roads: tuple[str, ...]
    index: Mapping[str, int]
    following: IntArray  # (R, K) roads, -1 for none
    shares: FloatArray  # (R, K), relative to their sum

    @classmethod
    def of(cls, turns: Turns, shares_of: Callable[[str], Sequence[float]]) -> Self:
        """``shares_of`` gives a road's shares by turn; next roads of one turn have equal parts."""
        roads = tuple(sorted({*turns, *(road for row in turns.values() for road in row)}))
        index = {road: number for number, road in enumerate(roads)}
        width = max((len(row) for row in turns.values()), default=0)
        following = np.full((len(roads), width), NONE, dtype=np.int64)
        shares = np.zeros(following.shape)
        for road, row in turns.items():
            wanted, made = shares_of(road), list(row.values())
            following[index[road], : len(row)] = [index[target] for target in row]
            shares[index[road], : len(row)] = [wanted[turn] / made.count(turn) for turn in made]
        return cls(roads, index, following, shares)

    def numbers(self, roads: Sequence[str]) -> IntArray:
        """The positions of roads in the graph."""
        return np.array([self.index[road] for road in roads], dtype=np.int64)

    def distances(self, exits: IntArray) -> IntArray:
        """(R, X): the fewest roads still to take from each road to each exit, ``FAR`` for no way.

        Only turns with a share are ways.
        """
        open_turns = self.shares[:, :, None] > 0
        distance = np.full((len(self.roads), exits.size), FAR)
        distance[exits, np.arange(exits.size)] = 0
        while True:
            beyond = np.where(open_turns, distance[self.following], FAR).min(axis=1) + 1
            if (beyond >= distance).all():
                return distance
            distance = np.minimum(distance, beyond)

    def reversals(self, entries: IntArray, exits: IntArray) -> BoolArray:
        """(E, X): whether the exit starts where the entry ends and no turn leads there."""
        leads = np.zeros((len(self.roads), len(self.roads)), dtype=np.float32)
        road, option = np.nonzero(self.following != NONE)
        leads[road, self.following[road, option]] = 1.0
        same_junction = (leads[entries] @ leads.T) @ leads[:, exits] > 0
        reversal: BoolArray = same_junction & (leads[np.ix_(entries, exits)] == 0)
        return reversal


def walk(graph: RoadGraph, start: IntArray, rng: np.random.Generator) -> list[Route]:
    """Routes from the roads ``start`` (V,): every turn is drawn by the road's turn shares.

    A walk ends where there is no way on, or before a road that it has already used.
    """
    path = start[:, None]  # (V, steps so far), -1 after the end
    active = np.arange(start.size)
    while active.size:
        past = path[active]
        options, shares = graph.following[past[:, -1]], graph.shares[past[:, -1]]
        following = _choose(options, shares, rng)
        used = (past == following[:, None]).any(axis=1)
        following[used] = NONE
        path, active = _extend(path, active, following)
    return _routes(graph, path)


def shortest_paths(
    graph: RoadGraph, start: IntArray, exits: IntArray, goal: IntArray, rng: np.random.Generator
) -> list[Route]:
    """Routes with the fewest roads from ``start`` (V,) to ``exits[goal]`` (V,).

    Where several are as short, each turn is drawn by the shares of those that lie on one.
    """
    distance = graph.distances(exits)
    path = start[:, None]
    active = np.arange(start.size)
    while active.size:
        here, to = path[active, -1], goal[active]
        options = graph.following[here]
        nearer = distance[options, to[:, None]] == distance[here, to][:, None] - 1
        following = _choose(options, np.where(nearer, graph.shares[here], 0.0), rng)
        path, active = _extend(path, active, following)
    return _routes(graph, path)


def _choose(options: IntArray, weights: FloatArray, rng: np.random.Generator) -> IntArray:
    """(V,): one of each row's options (V, K), by weight; -1 where all weights are 0."""
    choice = draw_columns(weights, rng)
    drawn = options[np.arange(len(options)), choice]
    return np.where(weights.sum(axis=1) > 0, drawn, NONE)


def draw_columns(weights: FloatArray, rng: np.random.Generator) -> IntArray:
    """(V,): a column of each row (V, K), by weight."""
    bounds = weights.cumsum(axis=1)
    drawn = rng.random(len(weights)) * bounds[:, -1]
    return np.asarray((drawn[:, None] >= bounds[:, :-1]).sum(axis=1), dtype=np.int64)


def _extend(path: IntArray, active: IntArray, following: IntArray) -> tuple[IntArray, IntArray]:
    """The paths one step on, and which of them are still under way."""
    column = np.full(len(path), NONE, dtype=np.int64)
    column[active] = following
    return np.column_stack((path, column)), active[following != NONE]


def _routes(graph: RoadGraph, path: IntArray) -> list[Route]:
    lengths = (path != NONE).sum(axis=1).tolist()
    names = np.array(graph.roads, dtype=object)[path].tolist()
    return [tuple(row[:length]) for row, length in zip(names, lengths, strict=True)]
