"""A conformance test for imputers, for users who write their own."""

import copy
from collections.abc import Callable

import numpy as np

from tsc_missing.controllers.trial import (
    INTERVAL,
    require,
    require_unchanged,
    trial_context,
    trial_world,
)
from tsc_missing.imputation.base import Imputer
from tsc_missing.network.model import Network
from tsc_missing.sensing.observation import Observation, apply_mask


def check_imputer(make: Callable[[], Imputer], network: Network) -> None:
    """Raise ``AssertionError``, with words, unless the imputers that ``make`` builds conform.

    They are reset on the network and fed observations with random holes, one intersection
    without sensors and a spell without any report. Every answer must have finite values and exits;
    what was reported must stay as it was, and so must the observation that was given; and the same
    seed must give the same values, after another reset and from another imputer.
    """
    imputer = make()
    first = _run(imputer, network)
    require(
        _equal(first, _run(imputer, network)),
        "after reset the same seed and observations must give the same values: the imputer "
        "remembers something, or draws random numbers that do not come from context.seed",
    )
    require(
        _equal(first, _run(make(), network)),
        "two imputers with the same seed and the same reports must give the same values",
    )


def _run(imputer: Imputer, network: Network) -> list[Observation]:
    """What it makes of a run."""
    context = trial_context(network)
    imputer.reset(context)
    phase = np.zeros(network.n, dtype=np.int64)
    red_steps = network.first_red_steps()
    answers = []
    for step, (truth, mask) in enumerate(trial_world(context)):
        observation = apply_mask(truth, mask, step, step * INTERVAL, phase, red_steps)
        answers.append(_fill(imputer, observation))
        red_steps = network.next_red_steps(red_steps, phase)
    return answers


def _fill(imputer: Imputer, observation: Observation) -> Observation:
    given = copy.deepcopy(observation)
    where = f"at step {observation.step}"
    try:
        filled = imputer.fill(given)
    except Exception as error:
        raise AssertionError(f"{where} the imputer raised {error!r}") from error
    if not isinstance(filled, Observation):
        raise AssertionError(f"{where} fill must return an Observation, not {type(filled)}")
    require_unchanged(given, observation, f"{where} fill")
    for name in ("values", "exits"):
        before, after = getattr(observation, name), np.asarray(getattr(filled, name))
        require(
            after.shape == before.shape,
            f"{where} {name} must have the shape {before.shape}, not {after.shape}",
        )
        require(bool(np.isfinite(after).all()), f"{where} {name} must be finite everywhere")
        require(bool((after >= 0).all()), f"{where} {name} must not be below 0")
        seen = np.isfinite(before)
        require(
            np.array_equal(before[seen], after[seen]),
            f"{where} fill must leave the reported {name} as they are",
        )
    require(
        np.array_equal(filled.mask, observation.mask), f"{where} fill must leave the mask as it is"
    )
    return copy.deepcopy(filled)


def _equal(some: list[Observation], others: list[Observation]) -> bool:
    return all(
        np.array_equal(a.values, b.values) and np.array_equal(a.exits, b.exits)
        for a, b in zip(some, others, strict=True)
    )
