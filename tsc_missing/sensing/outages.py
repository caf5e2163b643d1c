"""Outages: a chain of two states that fails with probability f and recovers with r at each step.

With r = 1 / mean_outage it is missing f / (f + r) of the time, which at f = 1 is the most it can
be.
"""

import numpy as np

from tsc_missing.network.model import BoolArray, FloatArray


def largest_share(mean_outage: float) -> float:
    """The largest share of time below 1 that outages of this mean length [steps] can cover."""
    return mean_outage / (mean_outage + 1)


def outages(share: float | FloatArray, mean_outage: float, chance: FloatArray) -> BoolArray:
    """(T, …): true in an outage, from chains that are in their stationary state from the start.

    ``share`` of time in an outage, all 1 or each at most ``largest_share``, and of a shape (…)
    that broadcasts; ``chance`` (T, …) are uniform random numbers in [0, 1).
    """
    if np.all(np.equal(share, 1)):
        return np.ones(chance.shape, dtype=bool)
    recover = 1 / mean_outage
    fail = share * recover / (1 - share)
    out = chance < share
    for step in range(1, len(chance)):
        out[step] = np.where(out[step - 1], chance[step] >= recover, chance[step] < fail)
    return out
