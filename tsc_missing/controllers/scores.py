"""Scoring phases through the slots they serve, and choosing the best."""

import numpy as np

from tsc_missing.network.model import FloatArray, IntArray, Network

TIE_DECIMALS = 9  # scores that differ by rounding errors only are ties


def phase_scores(network: Network, slot_scores: FloatArray) -> FloatArray:
    """(N, P): the sum of ``slot_scores`` (N, 12) over each phase's slots; -inf: no such phase.

    Slots that no phase serves do not matter; a NaN in any other makes its phases' scores NaN.
    """
    sums = np.where(network.phases, slot_scores[:, None, :], 0.0).sum(axis=2)
    return np.where(network.phase_mask, sums, -np.inf)


def best_phases(scores: FloatArray, name: str) -> IntArray:
    """(N,): the phase with the largest of ``scores`` (N, P); ties go to the lowest phase.

    Raises ``ValueError`` in the name of the controller if a score is NaN.
    """
    if np.isnan(scores).any():
        raise ValueError(
            f"{name} needs an imputer in front of it: the observation has holes (NaN) in values "
            f"that it uses, at intersections {np.flatnonzero(np.isnan(scores).any(axis=1))}"
        )
    best: IntArray = np.argmax(scores.round(TIE_DECIMALS), axis=1).astype(np.int64)
    return best


def overruled(network: Network, phases: IntArray, urgency: FloatArray) -> IntArray:
    """(N,): ``phases`` (N,), but where slots are urgent the phase that serves most of it.

    ``urgency`` (N, 12) is at least 0 and 0 where there is no hurry; among phases that serve equally
    much of it the given one stays, else the lowest is next.
    """
    scores = np.where(network.phases, urgency[:, None, :], 0.0).sum(axis=2).round(TIE_DECIMALS)
    best = scores.max(axis=1)
    own = (scores == best[:, None])[np.arange(len(phases)), phases] & (phases >= 0)
    return np.where((best > 0) & ~own, scores.argmax(axis=1), phases).astype(np.int64)


def downstream_mean(network: Network, values: FloatArray, boundary: FloatArray) -> FloatArray:
    """(N, 12): the mean per lane over the roads that each slot's movement leads to.

    ``values`` (N, 12) are counts of slots, so those of the exit lanes that end at the next
    signal; ``boundary`` (N, 12) are counts on the exit lanes that end at none.
    """
    linked = network.downstream >= 0
    counts = np.where(linked, values.reshape(-1)[network.downstream], 0.0).sum(axis=2)
    mean: FloatArray = (counts + boundary) / np.maximum(network.exit_lane_count, 1)
    return mean
