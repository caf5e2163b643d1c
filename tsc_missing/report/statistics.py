"""Means, standard errors, and bootstrap intervals of paired comparisons."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tsc_missing.network.model import FloatArray, IntArray

RESAMPLES = 10_000
LEVEL = 0.95


@dataclass(frozen=True)
class Mean:
    """A mean over n values; ``error`` is its standard error, None for a single value."""

    value: float
    error: float | None
    n: int


@dataclass(frozen=True)
class Ratio:
    """A ratio of means over n pairs with its bootstrap interval, None for a single pair."""

    value: float
    interval: tuple[float, float] | None
    n: int


@dataclass(frozen=True)
class Pairs:
    """The values of two methods by seed, in the order of ``seeds``."""

    seeds: tuple[int, ...]
    values: FloatArray  # (n, 2)

    def __len__(self) -> int:
        """The number of pairs."""
        return len(self.seeds)


def mean_of(values: Sequence[float]) -> Mean | None:
    """Mean ± s / √n with the sample's standard deviation s; None without values."""
    n = len(values)
    if n == 0:
        return None
    error = float(np.std(values, ddof=1)) / math.sqrt(n) if n > 1 else None
    return Mean(float(np.mean(values)), error, n)


def paired(one: dict[int, float], other: dict[int, float]) -> Pairs:
    """The values of both by the seeds that they have in common, in their order."""
    common = tuple(sorted(one.keys() & other.keys()))
    values = np.array([(one[seed], other[seed]) for seed in common], dtype=float)
    return Pairs(common, values.reshape(-1, 2))


def ratio_of(strata: Sequence[Pairs], seed: int = 0) -> Ratio | None:
    """How many times its partner the first of each pair is; None without pairs.

    ``strata`` are the pairs of one dataset and case each: the ratio is the geometric mean over
    them of the ratio of means. The interval is the percentile bootstrap's at 95 %. A seed makes
    the masks of all strata alike, so seeds are drawn, for all strata together; how far a draw is
    off is the mean over the strata that have any of its seeds. Strata of one pair only are as they
    are. Strata with a value of 0 have no such ratio and are left out.
    """
    strata = [pairs for pairs in strata if len(pairs) and (pairs.values > 0).all()]
    if not strata:
        return None
    value = math.exp(float(np.mean([_log_ratio(pairs.values) for pairs in strata])))
    n = sum(len(pairs) for pairs in strata)
    if max(len(pairs) for pairs in strata) < 2:
        return Ratio(value, None, n)
    seeds = sorted({one for pairs in strata for one in pairs.seeds})
    drawn = np.random.default_rng(seed).integers(len(seeds), size=(RESAMPLES, len(seeds)))
    times = (drawn[:, :, None] == np.arange(len(seeds))).sum(axis=1)  # (RESAMPLES, seeds)
    off = np.nanmean([_off(pairs, seeds, times) for pairs in strata], axis=0)
    low, high = value * np.exp(np.quantile(off, [(1 - LEVEL) / 2, (1 + LEVEL) / 2]))
    return Ratio(value, (float(low), float(high)), n)


def _log_ratio(values: FloatArray) -> float:
    one, other = values.mean(axis=0)
    return math.log(one / other)


def _off(pairs: Pairs, seeds: Sequence[int], times: IntArray) -> FloatArray:
    """(RESAMPLES,): of the logarithm of the ratio of means; NaN where none of its seeds was drawn.

    ``times`` (RESAMPLES, seeds) is how often each of ``seeds`` was drawn.
    """
    if len(pairs) == 1:
        return np.zeros(len(times))
    sums = times[:, [seeds.index(one) for one in pairs.seeds]] @ pairs.values
    with np.errstate(invalid="ignore"):
        logs: FloatArray = np.log(sums[:, 0] / sums[:, 1])
    return logs - _log_ratio(pairs.values)
