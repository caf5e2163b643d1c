"""A conformance test for controllers, for users who write their own."""

import copy
from collections.abc import Callable

import numpy as np

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.trial import (
    INTERVAL,
    require,
    require_unchanged,
    trial_context,
    trial_world,
)
from tsc_missing.network.model import IntArray, Network
from tsc_missing.sensing.observation import Observation, apply_mask


def check_controller(make: Callable[[], Controller], network: Network) -> None:
    """Raise ``AssertionError``, with words, unless the controllers that ``make`` builds conform.

    They are reset on the network and fed observations with random holes, one intersection
    without sensors and a spell without any report. Every answer must be an array of N integers
    that are phases of their intersections; observations must be left as they are; and the same seed
    must give the same answers, after another reset and from another controller.
    """
    context = trial_context(network)
    controller = make()
    first = _run(controller, context)
    again = _run(controller, context)
    require(
        np.array_equal(first, again),
        "after reset the same seed and observations must give the same phases: the controller "
        "remembers something, or draws random numbers that do not come from context.seed",
    )
    other = _run(make(), context)
    require(
        np.array_equal(first, other),
        "two controllers with the same seed and the same reports must give the same phases",
    )


def _run(controller: Controller, context: ControlContext) -> IntArray:
    """(STEPS, N): the phases of a run."""
    network = context.network
    controller.reset(context)
    phase = np.full(network.n, -1, dtype=np.int64)
    red_steps = network.first_red_steps()
    answers = []
    for step, (truth, mask) in enumerate(trial_world(context)):
        observation = apply_mask(truth, mask, step, step * INTERVAL, phase, red_steps)
        phase = _decide(controller, observation, network)
        answers.append(phase)
        red_steps = network.next_red_steps(red_steps, phase)
    return np.array(answers)


def _decide(controller: Controller, observation: Observation, network: Network) -> IntArray:
    given = copy.deepcopy(observation)
    where = f"at step {observation.step}"
    try:
        answer = controller.decide(given)
        estimates = controller.estimates()
    except Exception as error:
        raise AssertionError(f"{where} the controller raised {error!r}") from error
    _check_phases(answer, network, where)
    require_unchanged(given, observation, f"{where} decide")
    shape = observation.values.shape
    require(
        estimates is None or np.shape(estimates) == shape,
        f"{where} estimates() must be None or an array of the shape {shape}",
    )
    return np.array(answer, dtype=np.int64)


def _check_phases(answer: object, network: Network, where: str) -> None:
    if not isinstance(answer, np.ndarray):
        raise AssertionError(f"{where} decide must return a NumPy array, not {type(answer)}")
    require(
        answer.shape == (network.n,),
        f"{where} decide must return the shape ({network.n},), not {answer.shape}",
    )
    require(
        np.issubdtype(answer.dtype, np.integer),
        f"{where} decide must return integers, not {answer.dtype}",
    )
    for n, phase in enumerate(answer):
        count = int(network.phase_mask[n].sum())
        # of an own controller, what is no phase comes here as -1
        found = f", not {phase}" if phase >= 0 else ""
        require(
            0 <= phase < count,
            f"{where} the answer at intersection {network.ids[n]} must be one of its {count} "
            f"phases, 0 to {count - 1}{found}",
        )
