"""A conformance test for controllers, for users who write their own."""

import copy
from collections.abc import Callable, Iterator
from dataclasses import fields

import numpy as np

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.network.model import BoolArray, IntArray, Network
from tsc_missing.sensing.observation import N_FEATURES, Measurement, Observation, apply_mask

STEPS = 31  # a prime, so that no short cycle of a forgetful reset fits into it
INTERVAL = 15.0  # [s]
LOST_TIME = 5.0  # [s]


def check_controller(make: Callable[[], Controller], network: Network) -> None:
    """Raise ``AssertionError``, with words, unless the controllers that ``make`` builds conform.

    They are reset on the network and fed observations with random holes, one intersection
    without sensors and a spell without any report. Every answer must be an array of N integers
    that are phases of their intersections; observations must be left as they are; the same seed
    must give the same answers, after another reset and from another controller; and numbers
    under the holes must not matter.
    """
    context = _context(network)
    controller = make()
    first = _run(controller, context, hidden=0)
    again = _run(controller, context, hidden=0)
    _require(
        np.array_equal(first, again),
        "after reset the same seed and observations must give the same phases: the controller "
        "remembers something, or draws random numbers that do not come from context.seed",
    )
    other = _run(make(), context, hidden=1)
    _require(
        np.array_equal(first, other),
        "two controllers with the same seed and the same reports must give the same phases, "
        "whatever the truth where nothing was reported",
    )


def _context(network: Network) -> ControlContext:
    random = np.random.default_rng(0)
    sensors = np.ones_like(network.slot_mask)
    if network.n > 1:
        sensors[0] = ~network.slot_mask[0]
    return ControlContext(
        network=network,
        turning_flows=random.uniform(0, 500, network.slot_mask.shape) * network.slot_mask,
        sensors=sensors,
        decision_interval=INTERVAL,
        lost_time=LOST_TIME,
        seed=7,
    )


def _run(controller: Controller, context: ControlContext, hidden: int) -> IntArray:
    """(STEPS, N): the phases of a run; ``hidden`` seeds the truth where nothing is reported."""
    network = context.network
    controller.reset(context)
    phase = np.full(network.n, -1, dtype=np.int64)
    red_steps = network.first_red_steps()
    answers = []
    for step, (truth, mask) in enumerate(_world(context, hidden)):
        observation = apply_mask(truth, mask, step, step * INTERVAL, phase, red_steps)
        phase = _decide(controller, observation, network)
        answers.append(phase)
        red_steps = network.next_red_steps(red_steps, phase)
    return np.array(answers)


def _world(context: ControlContext, hidden: int) -> Iterator[tuple[Measurement, BoolArray]]:
    """Truth and mask of each step; the middle third of the steps has no report at all."""
    slots = context.network.slot_mask
    random, unseen = np.random.default_rng(1), np.random.default_rng([2, hidden])
    for step in range(STEPS):
        reported = context.sensors & (random.random(slots.shape) < 0.5)
        if STEPS // 3 <= step < 2 * STEPS // 3:
            reported = np.zeros_like(slots)
        mask = reported | ~slots
        seen, under = (r.integers(0, 9, (*slots.shape, 3)) for r in (random, unseen))
        counts = np.where(mask[:, :, None], seen, under) * slots[:, :, None] * 1.0
        counts[:, :, 0] += counts[:, :, 1]
        yield Measurement(values=counts[:, :, :N_FEATURES], exits=counts[:, :, N_FEATURES]), mask


def _decide(controller: Controller, observation: Observation, network: Network) -> IntArray:
    given = copy.deepcopy(observation)
    where = f"at step {observation.step}"
    try:
        answer = controller.decide(given)
        estimates = controller.estimates()
    except Exception as error:
        raise AssertionError(f"{where} the controller raised {error!r}") from error
    _check_phases(answer, network, where)
    _check_unchanged(given, observation, where)
    shape = observation.values.shape
    _require(
        estimates is None or np.shape(estimates) == shape,
        f"{where} estimates() must be None or an array of the shape {shape}",
    )
    return np.array(answer, dtype=np.int64)


def _check_phases(answer: object, network: Network, where: str) -> None:
    if not isinstance(answer, np.ndarray):
        raise AssertionError(f"{where} decide must return a NumPy array, not {type(answer)}")
    _require(
        answer.shape == (network.n,),
        f"{where} decide must return the shape ({network.n},), not {answer.shape}",
    )
    _require(
        np.issubdtype(answer.dtype, np.integer),
        f"{where} decide must return integers, not {answer.dtype}",
    )
    for n, phase in enumerate(answer):
        count = int(network.phase_mask[n].sum())
        _require(
            0 <= phase < count,
            f"{where} phase {phase} is not at intersection {network.ids[n]}, which has {count}",
        )


def _check_unchanged(given: Observation, observation: Observation, where: str) -> None:
    for field in fields(Observation):
        before, after = getattr(observation, field.name), getattr(given, field.name)
        _require(
            np.array_equal(before, after, equal_nan=field.name != "mask"),
            f"{where} decide must not change observation.{field.name}",
        )


def _require(condition: bool | np.bool_, words: str) -> None:
    if not condition:
        raise AssertionError(words)
