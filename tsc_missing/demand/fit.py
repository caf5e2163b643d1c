"""From a demand to its profile: counts and shares, coarse enough to hold no single trip."""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from tsc_missing.demand.profile import DemandProfile, Shares, Turns, plain_turns
from tsc_missing.demand.trips import Demand, Trip
from tsc_missing.network.plain import PlainNetwork
from tsc_missing.network.slots import TURNS

SIGNIFICANT = 9.21  # chi-squared with 2 degrees of freedom, exceeded by chance once in 100

IntArray = npt.NDArray[np.int64]


def fit_profile(
    demand: Demand, plain: PlainNetwork, bin_length: int = 300, horizon: int = 3600
) -> DemandProfile:
    """The profile of the trips that depart before ``horizon`` [s], in bins of ``bin_length`` [s].

    A road has turn shares of its own only where they differ significantly from the network's.
    """
    turns = plain_turns(plain)
    trips = [trip for trip in demand.trips if trip.depart < horizon]
    counts = _turn_counts(trips, turns)
    total = np.sum(list(counts.values()), axis=0)
    return DemandProfile(
        bin=bin_length,
        irregularity=_irregularity(trips, bin_length),
        repeats="end" if any(turns.get(trip.route[-1]) for trip in trips) else "avoid",
        turns=_shares(total),
        road_turns={
            road: _shares(row) for road, row in sorted(counts.items()) if _differs(row, total)
        },
        arrivals=_arrivals(trips, bin_length, horizon),
    )


def _turn_counts(trips: list[Trip], turns: Turns) -> dict[str, IntArray]:
    """(3,) vehicles that turn left, go straight and turn right at the end of each road."""
    counts = {road: np.zeros(len(TURNS), dtype=np.int64) for road in turns}
    for trip in trips:
        for start, end in zip(trip.route, trip.route[1:], strict=False):
            counts[start][turns[start][end]] += 1
    return counts


def _differs(row: IntArray, total: IntArray) -> bool:
    """Whether a road's turns are unlikely to be drawn from the network's shares (chi-squared)."""
    expected = row.sum() * total / total.sum()
    there = expected > 0
    return float(((row - expected)[there] ** 2 / expected[there]).sum()) > SIGNIFICANT


def _shares(counts: IntArray) -> Shares:
    left, straight, right = (round(float(c) / int(counts.sum()), 3) for c in counts)
    return left, straight, right


def _arrivals(trips: list[Trip], bin_length: int, horizon: int) -> dict[str, tuple[float, ...]]:
    bins = -(-horizon // bin_length)
    table = {road: [0.0] * bins for road in sorted({trip.route[0] for trip in trips})}
    for trip in trips:
        table[trip.route[0]][int(trip.depart // bin_length)] += 1.0
    return {road: tuple(row) for road, row in table.items()}


def _irregularity(trips: list[Trip], bin_length: int) -> float:
    """The coefficient of variation of the headways within entry road and bin, at most 1."""
    deviations = np.array(list(_headways(trips, bin_length)))
    return min(round(float(np.sqrt((deviations**2).mean())), 2), 1.0) if deviations.size else 1.0


def _headways(trips: list[Trip], bin_length: int) -> Iterator[float]:
    """Headways relative to their mean in the entry road and bin, minus 1."""
    cells: dict[tuple[str, int], list[float]] = {}
    for trip in trips:
        cells.setdefault((trip.route[0], int(trip.depart // bin_length)), []).append(trip.depart)
    for departs in cells.values():
        gaps = np.diff(departs)
        if gaps.size > 1 and gaps.mean() > 0:
            yield from (gaps / gaps.mean() - 1.0).tolist()
