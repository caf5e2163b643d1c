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


def mean_of(values: Sequence[float]) -> Mean | None:
    """Mean ± s / √n with the sample's standard deviation s; None without values."""
    n = len(values)
    if n == 0:
        return None
    error = float(np.std(values, ddof=1)) / math.sqrt(n) if n > 1 else None
    return Mean(float(np.mean(values)), error, n)


def paired(one: dict[int, float], other: dict[int, float]) -> FloatArray:
    """(n, 2): the values of both by what they have in common, in its order."""
    common = sorted(one.keys() & other.keys())
    return np.array([(one[key], other[key]) for key in common], dtype=float).reshape(-1, 2)


def ratio_of(strata: Sequence[FloatArray], seed: int = 0) -> Ratio | None:
    """How many times its partner the first of each pair is; None without pairs.

    ``strata`` are (n, 2) pairs of one dataset and case each: the ratio is the geometric mean over
    them of the ratio of means. The interval is the percentile bootstrap's at 95 %. The pairs at one
    place in strata of one length are of one seed, which makes their masks alike, so they are drawn
    together; strata of one pair only are as they are. Strata with a value of 0 have no such ratio
    and are left out.
    """
    strata = [pairs for pairs in strata if len(pairs) and (pairs > 0).all()]
    if not strata:
        return None
    value = math.exp(float(np.mean([_log_ratio(pairs) for pairs in strata])))
    n = sum(len(pairs) for pairs in strata)
    if max(len(pairs) for pairs in strata) < 2:
        return Ratio(value, None, n)
    rng = np.random.default_rng(seed)
    lengths = sorted({len(pairs) for pairs in strata})
    drawn = {n: rng.integers(n, size=(RESAMPLES, n)) for n in lengths}
    logs = np.mean([_resampled(pairs, drawn[len(pairs)]) for pairs in strata], axis=0)
    low, high = np.exp(np.quantile(logs, [(1 - LEVEL) / 2, (1 + LEVEL) / 2]))
    return Ratio(value, (float(low), float(high)), n)


def _log_ratio(pairs: FloatArray) -> float:
    one, other = pairs.mean(axis=0)
    return math.log(one / other)


def _resampled(pairs: FloatArray, places: IntArray) -> FloatArray:
    """(RESAMPLES,): the logarithm of the ratio of means of the pairs at ``places``, row by row."""
    drawn = pairs[places].mean(axis=1)
    logs: FloatArray = np.log(drawn[:, 0] / drawn[:, 1])
    return logs
