"""Which sensors report when: masks of the missing-data patterns, drawn from a seed.

A mask is (T, N, 12), true = reported. Slots that an intersection does not have always count as
reported: it is known that nothing is there. With the same seed a longer mask begins with the
shorter one.
"""

import math
from collections.abc import Callable

import numpy as np

from tsc_missing.config import MissingSettings
from tsc_missing.errors import UserError
from tsc_missing.network.model import BoolArray, FloatArray, IntArray, Network
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.seeding import stream
from tsc_missing.sensing.outages import largest_share, outages

Pattern = Callable[[MissingSettings, Network, int, np.random.Generator], BoolArray]


def draw_mask(settings: MissingSettings, network: Network, steps: int, seed: int) -> BoolArray:
    """(T, N, 12): which slots report at each of ``steps`` decision steps."""
    reported = PATTERNS[settings.pattern](settings, network, steps, stream(seed, "mask"))
    absent = ~network.slot_mask
    return np.broadcast_to(reported, (steps, network.n, N_SLOTS)) | absent


def equipped(settings: MissingSettings, network: Network, seed: int) -> BoolArray:
    """(N, 12): the inventory of a drawn mask: which slots have a sensor, that may fail.

    Those of blind intersections have none, nor have those that ``lasting`` silences, and where all
    is missing there are none; the others are there, however long they are silent.
    """
    there = network.slot_mask & (settings.rate < 1 or settings.pattern == "none")
    rng = stream(seed, "mask")
    if settings.pattern == "kriging":
        there = there & _kriging(settings, network, 1, rng)[0]
    if settings.lasting:
        there = there & _lane(settings, network, 1, rng)[0]
    if settings.pattern == "mixed":
        there = there & _without(_blind_in_mixture(settings, network, rng)[0], network.n)[0]
    return there | ~network.slot_mask


def _none(
    settings: MissingSettings, network: Network, steps: int, rng: np.random.Generator
) -> BoolArray:
    """Everything reports."""
    return np.ones((steps, 1, 1), dtype=bool)


def _random(
    settings: MissingSettings, network: Network, steps: int, rng: np.random.Generator
) -> BoolArray:
    """(T, N, 1): each step of each intersection is missing with probability ``rate``."""
    return rng.random((steps, network.n, 1)) >= settings.rate


def _lane(
    settings: MissingSettings, network: Network, steps: int, rng: np.random.Generator
) -> BoolArray:
    """(T, N, 12): each step of each slot is missing with probability ``rate``.

    With ``lasting`` (1, N, 12): ``rate`` of the slots, at least one unless it is 0, never report.
    Those that share sensors count as one.
    """
    if settings.lasting:
        return ~_silent_for_good(settings.rate, network, rng)[None]
    return _by_lanes(rng.random((steps, network.n, N_SLOTS)) >= settings.rate, network)


def _kriging(
    settings: MissingSettings, network: Network, steps: int, rng: np.random.Generator
) -> BoolArray:
    """(1, N, 1): ``rate`` of the intersections, at least one unless it is 0, never report."""
    count = _at_least_one(settings.rate, network.n)
    draw = _surrounded_set if settings.adjacent else _spread_set
    return _without(draw(network, count, settings.rate, rng), network.n)


def _burst(
    settings: MissingSettings, network: Network, steps: int, rng: np.random.Generator
) -> BoolArray:
    """(T, N, 1): outages of ``mean_outage`` steps on average cover ``rate`` of the time."""
    most = largest_share(settings.mean_outage)
    _check_outages(settings, most)
    chance = rng.random((steps, network.n))
    return ~outages(settings.rate, settings.mean_outage, chance)[:, :, None]


def _mixed(
    settings: MissingSettings, network: Network, steps: int, rng: np.random.Generator
) -> BoolArray:
    """(T, N, 12): blind intersections, bursts and single lanes together.

    The blind intersections are non-adjacent and take as much of a third of ``rate`` as can be
    placed, a share a of the slots. Bursts and lanes are each missing with probability b, all three
    independent, so that the expected share of missing slots is 1 - (1 - a)(1 - b)^2 = ``rate``.
    """
    _check_outages(settings, 1 - (1 - largest_share(settings.mean_outage)) ** 2)
    blind, blind_share = _blind_in_mixture(settings, network, rng)
    rest = 1 - math.sqrt((1 - settings.rate) / (1 - blind_share))
    chance = rng.random((steps, network.n, 1 + N_SLOTS))
    out = outages(rest, settings.mean_outage, chance[:, :, 0])[:, :, None]
    lanes = _by_lanes(chance[:, :, 1:] >= rest, network)
    return _without(blind, network.n) & ~out & lanes


def _blind_in_mixture(
    settings: MissingSettings, network: Network, rng: np.random.Generator
) -> tuple[IntArray, float]:
    """The blind intersections of ``_mixed``, and their share of the slots."""
    order = _greedy_independent(network.adjacency, rng.permutation(network.n))
    shares = np.cumsum(network.slot_mask[order].sum(axis=1)) / network.slot_mask.sum()
    count = int(np.searchsorted(shares, settings.rate / 3 + 1e-9, side="right"))
    return order[:count], float(shares[count - 1]) if count else 0.0


PATTERNS: dict[str, Pattern] = {
    "none": _none,
    "random": _random,
    "kriging": _kriging,
    "lane": _lane,
    "burst": _burst,
    "mixed": _mixed,
}


def _by_lanes(reported: BoolArray, network: Network) -> BoolArray:
    """(T, N, 12): slots that share lanes as the first of them in ``reported`` (T, N, 12)."""
    return np.take_along_axis(reported, network.slots_in_common[None], axis=2)


def _silent_for_good(rate: float, network: Network, rng: np.random.Generator) -> BoolArray:
    """(N, 12): the slots whose sensors are the first ``rate`` of them in a random order."""
    first = np.arange(network.n)[:, None] * N_SLOTS + network.slots_in_common
    sensors = rng.permutation(np.unique(first[network.slot_mask]))
    silent = sensors[: _at_least_one(rate, len(sensors))]
    return np.isin(first, silent) & network.slot_mask


def _without(blind: IntArray, n: int) -> BoolArray:
    """(1, N, 1): true but for the intersections ``blind``."""
    return ~np.isin(np.arange(n), blind)[None, :, None]


def _at_least_one(rate: float, n: int) -> int:
    """``rate`` of n, rounded half up, and 0 of rate 0 only; as exact as rates in decimals are."""
    return max(math.floor(round(rate * n, 9) + 0.5), int(rate > 0))


def _check_outages(settings: MissingSettings, most: float) -> None:
    if most < settings.rate < 1:
        shown = math.floor(most * 1e4) / 1e4
        raise UserError(
            "rate",
            settings.rate,
            f"with mean_outage {settings.mean_outage:g} it may be at most {shown:g}, or 1; "
            "a larger mean_outage allows more",
        )


# Blind sets.


def _spread_set(network: Network, count: int, rate: float, rng: np.random.Generator) -> IntArray:
    """``count`` intersections of which no two are adjacent; ``UserError`` if there are none."""
    found = _independent(network.adjacency, count, rng)
    if found is None:
        most = len(_solve_independent(network.adjacency, np.ones(network.n), None))
        raise UserError(
            "rate",
            rate,
            f"at most {most} of the {network.n} intersections (rate {most / network.n:.4g}) can "
            "be blind without two being adjacent",
        )
    return found


def _surrounded_set(
    network: Network, count: int, rate: float, rng: np.random.Generator
) -> IntArray:
    """``count`` intersections, among them one with all its neighbours.

    The others are neither adjacent to these nor to each other where that can be done.
    """
    if count == 0:
        return np.zeros(0, dtype=np.int64)
    sizes = 1 + network.adjacency.sum(axis=1)
    if sizes.min() > count:
        raise UserError(
            "rate",
            rate,
            f"at least {sizes.min()} of the {network.n} intersections (rate "
            f"{sizes.min() / network.n:.4g}) must be blind to hold one and all its neighbours",
        )
    centre = rng.choice(np.flatnonzero(sizes <= count))
    ring = network.adjacency[centre] | (np.arange(network.n) == centre)
    core = np.flatnonzero(ring)
    free = np.flatnonzero(~(ring | network.adjacency[core].any(axis=0)))
    others = _independent(network.adjacency[np.ix_(free, free)], count - len(core), rng)
    if others is not None:
        return np.concatenate([core, free[others]])
    rest = rng.permutation(np.flatnonzero(~ring))
    return np.concatenate([core, rest[: count - len(core)]])


def _independent(adjacency: BoolArray, count: int, rng: np.random.Generator) -> IntArray | None:
    """``count`` nodes of which no two are adjacent, or None where there are not so many.

    The first of a random order, so that the sets of one seed are nested, as far as a greedy
    choice in that order gets; beyond, a set of the right size with the largest random weight.
    """
    n = len(adjacency)
    if count > n:
        return None
    greedy = _greedy_independent(adjacency, rng.permutation(n))
    if count <= len(greedy):
        return greedy[:count]
    found = _solve_independent(adjacency, rng.random(n), count)
    return found if len(found) == count else None


def _greedy_independent(adjacency: BoolArray, order: IntArray) -> IntArray:
    """The nodes of ``order`` that are not adjacent to an earlier one that was taken."""
    taken: list[int] = []
    for node in order:
        if not adjacency[node, taken].any():
            taken.append(int(node))
    return np.array(taken, dtype=np.int64)


def _solve_independent(adjacency: BoolArray, weights: FloatArray, count: int | None) -> IntArray:
    """The heaviest set without adjacent nodes, of ``count`` nodes if given; empty if there is none.

    An integer program over x in {0, 1}^n: maximise weights . x, x_i + x_j <= 1 on each edge.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import coo_array

    n = len(adjacency)
    edges = np.argwhere(np.triu(adjacency))
    rows = np.repeat(np.arange(len(edges)), 2)
    shape = (len(edges), n)
    incidence = coo_array((np.ones(edges.size), (rows, edges.ravel())), shape=shape)
    constraints = [LinearConstraint(incidence, -np.inf, 1)]
    if count is not None:
        constraints.append(LinearConstraint(np.ones((1, n)), count, count))
    solution = milp(
        -weights,
        integrality=np.ones(n),
        bounds=Bounds(0, 1),
        constraints=constraints,
        options={"mip_rel_gap": 0.0},
    )
    if solution.x is None:
        return np.zeros(0, dtype=np.int64)
    return np.flatnonzero(solution.x > 0.5)
