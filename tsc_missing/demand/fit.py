"""From a demand to its profile: counts and shares, coarse enough to hold no single trip."""

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from tsc_missing.demand.profile import (
    DemandProfile,
    ExitShares,
    Shares,
    plain_turns,
    possible_exits,
)
from tsc_missing.demand.routing import FloatArray, IntArray, RoadGraph, Turns
from tsc_missing.demand.trips import Demand, Trip
from tsc_missing.network.plain import PlainNetwork
from tsc_missing.network.slots import APPROACHES, TURNS, assign_approaches, bearing

BIN = 300  # [s]
ENOUGH = 10  # vehicles a bin, on average, for an entry road to have a course of its own
SIGNIFICANT = 9.21  # chi-squared with 2 degrees of freedom, exceeded by chance once in 100
DIGITS = 3  # of shares
ROUNDS = 100  # of fitting exit weights to exit counts


def fit_profile(demand: Demand, plain: PlainNetwork, horizon: int = 3600) -> DemandProfile:
    """The profile of the trips that depart before ``horizon`` [s].

    An entry road with few vehicles follows the network's course over time, and a road has turn
    shares of its own only where they differ significantly from the network's. The profile has
    exits if every trip takes a shortest way over turns that are used at all.
    """
    turns = plain_turns(plain)
    trips = [trip for trip in demand.trips if trip.depart < horizon]
    counts = _turn_counts(trips, turns)
    total = np.sum(list(counts.values()), axis=0)
    own = {road for road, row in counts.items() if _differs(row, total, turns[road])}
    profile = DemandProfile(
        bin=BIN,
        irregularity=_irregularity(trips),
        turns=_shares(total),
        road_turns={road: _shares(counts[road]) for road in sorted(own)},
        exits=(),
        arrivals=_arrivals(trips, horizon),
    )
    graph = profile.graph(turns)
    if not _all_shortest(trips, graph):
        return profile
    return profile.model_copy(update={"exits": _exits(trips, graph, plain)})


def _turn_counts(trips: Sequence[Trip], turns: Turns) -> dict[str, IntArray]:
    """(3,) vehicles that turn left, go straight and turn right at the end of each road."""
    counts = {road: np.zeros(len(TURNS), dtype=np.int64) for road in turns}
    for trip in trips:
        for start, end in zip(trip.route, trip.route[1:], strict=False):
            counts[start][turns[start][end]] += 1
    return counts


def _differs(row: IntArray, total: IntArray, turns: dict[str, int]) -> bool:
    """Whether a road's turns are unlikely to be drawn from the network's shares (chi-squared).

    A turn that is there and never used differs in any case.
    """
    there = np.array([turn in turns.values() for turn in range(len(TURNS))]) & (total > 0)
    if not row.any():
        return False
    expected = row.sum() * total[there] / total[there].sum()
    deviation = ((row[there] - expected) ** 2 / expected).sum()
    return bool(deviation > SIGNIFICANT or (row[there] == 0).any())


def _shares(counts: IntArray) -> Shares:
    left, straight, right = np.round(counts / counts.sum(), DIGITS).tolist()
    return left, straight, right


def _arrivals(trips: Sequence[Trip], horizon: int) -> dict[str, tuple[float, ...]]:
    bins = np.arange(0, horizon + BIN, BIN)
    counts = {
        road: np.histogram([t.depart for t in trips if t.route[0] == road], bins)[0]
        for road in sorted({trip.route[0] for trip in trips})
    }
    course = np.sum(list(counts.values()), axis=0) / len(trips)
    return {
        road: tuple(
            (row if row.mean() >= ENOUGH else np.round(row.sum() * course, 1))
            .astype(float)
            .tolist()
        )
        for road, row in counts.items()
    }


def _irregularity(trips: Sequence[Trip]) -> float:
    """The coefficient of variation of the headways within entry road and bin, at most 1."""
    squares = np.array(list(_squared_deviations(trips)))
    return min(round(float(np.sqrt(squares.mean())), 2), 1.0) if squares.size else 1.0


def _squared_deviations(trips: Sequence[Trip]) -> Iterator[float]:
    """Of headways from their mean, relative to it; without the bias of small numbers."""
    cells: dict[tuple[str, int], list[float]] = {}
    for trip in trips:
        cells.setdefault((trip.route[0], int(trip.depart // BIN)), []).append(trip.depart)
    for departs in cells.values():
        gaps = np.diff(departs)
        if gaps.size > 1 and gaps.mean() > 0:
            unbiased = (gaps.size + 1) / (gaps.size - 1)
            yield from ((gaps / gaps.mean() - 1.0) ** 2 * unbiased).tolist()


def _all_shortest(trips: Sequence[Trip], graph: RoadGraph) -> bool:
    exits = sorted({trip.route[-1] for trip in trips})
    column = {road: number for number, road in enumerate(exits)}
    distance = graph.distances(graph.numbers(exits))
    return all(
        distance[graph.index[trip.route[0]], column[trip.route[-1]]] == len(trip.route) - 1
        for trip in trips
    )


def _exits(trips: Sequence[Trip], graph: RoadGraph, plain: PlainNetwork) -> tuple[ExitShares, ...]:
    """Exit shares for the entry roads of each side of the network."""
    pairs = Counter((trip.route[0], trip.route[-1]) for trip in trips)
    exits = sorted({road for _, road in pairs})
    groups: dict[int, list[str]] = {}
    for entry in sorted({road for road, _ in pairs}):
        groups.setdefault(_side(plain, entry), []).append(entry)
    shares = []
    for side in range(len(APPROACHES)):
        if side in groups:
            entries = groups[side]
            table = np.array([[pairs[e, x] for x in exits] for e in entries], dtype=np.float64)
            possible = possible_exits(graph, graph.numbers(entries), graph.numbers(exits))
            weights = _exit_weights(table, possible)
            chosen = {x: w for x, w in zip(exits, weights, strict=True) if w > 0}
            shares.append(ExitShares(entries=tuple(entries), exits=chosen))
    return tuple(shares)


def _side(plain: PlainNetwork, road: str) -> int:
    (x, y), (end_x, end_y) = plain.roads[road].shape[0], plain.roads[road].shape[-1]
    return assign_approaches([bearing(x - end_x, y - end_y)])[0]


def _exit_weights(table: FloatArray, possible: FloatArray) -> list[float]:
    """Weights of the X exits that lead, over the possible pairs, to the table's column sums.

    ``table`` (E, X) counts vehicles by entry and exit; its row sums are kept too.
    """
    weights = table.sum(axis=0)
    used = weights > 0
    for _ in range(ROUNDS):
        expected = possible * weights
        expected *= (table.sum(axis=1) / expected.sum(axis=1))[:, None]
        weights[used] *= table.sum(axis=0)[used] / expected.sum(axis=0)[used]
    rounded: list[float] = np.round(weights / weights.sum(), DIGITS).tolist()
    return rounded
