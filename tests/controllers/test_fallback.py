from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tests.controllers.helpers import (
    A,
    B,
    Scripted,
    context,
    cross_and_tee,
    observe,
    slot,
    with_holes,
)
from tsc_missing.controllers.fallback import Safe

NETWORK = cross_and_tee()
QUEUES = {(A, "W-left"): 5, (B, "S-left"): 5}
FALLBACK = [2, 2]  # max-queue's phases on QUEUES


class Clock:
    """Moves on by ``tick`` seconds whenever it is read."""

    def __init__(self, tick: float) -> None:
        self.tick, self.now = tick, 0.0

    def __call__(self) -> float:
        self.now += self.tick
        return self.now


def safe(answer, tick=0.0, deadline=1.0):
    controller = Safe(Scripted(answer), deadline, clock=Clock(tick))
    controller.reset(context(NETWORK))
    return controller


def ask(controller, holes=None, step=0):
    observation = observe(NETWORK, queue=QUEUES, step=step)
    return controller.decide(observation if holes is None else with_holes(observation, holes))


@pytest.mark.parametrize(
    "answer", [np.array([3, 1]), [3, 1], np.array([3.0, 1.0]), np.array([3, 1], dtype=np.uint8)]
)
def test_a_legal_answer_passes(answer):
    controller = safe(answer)
    assert ask(controller).tolist() == [3, 1]
    assert controller.fallback_steps == 0
    assert controller.last_error == ""


@pytest.mark.parametrize(
    ("answer", "phases", "count"),
    [
        (np.array([np.nan, 1.0]), [2, 1], 1),
        (np.array([0.5, 1.0]), [2, 1], 1),
        (np.array([0.0, np.inf]), [0, 2], 1),
        (np.array([4, 1]), [2, 1], 1),
        (np.array([0, 3]), [0, 2], 1),  # the T-junction has no phase 3
        (np.array([-1, 2**62]), [2, 2], 2),
    ],
)
def test_only_the_entries_that_are_wrong_are_replaced(answer, phases, count):
    controller = safe(answer)
    assert ask(controller).tolist() == phases
    assert controller.fallback_steps == count
    assert "no legal phase for" in controller.last_error


@pytest.mark.parametrize(
    "answer",
    [
        None,
        "0",
        7,
        np.zeros(3, dtype=int),
        np.zeros((2, 1), dtype=int),
        [[0], [0, 1]],
        np.array([True, False]),
        np.array([0j, 1j]),
        [10**30, 0],
        RuntimeError("no weights"),
        np.linalg.LinAlgError("singular"),
    ],
)
def test_other_answers_and_exceptions_are_replaced_as_a_whole(answer):
    controller = safe(answer)
    assert ask(controller).tolist() == FALLBACK
    assert controller.fallback_steps == 2
    assert controller.last_error


def test_a_late_answer_is_replaced_as_a_whole():
    assert ask(safe(np.array([3, 1]), tick=0.9)).tolist() == [3, 1]
    controller = safe(np.array([3, 1]), tick=1.1)
    assert ask(controller).tolist() == FALLBACK
    assert controller.last_error == "later than the deadline of 1 s"


@pytest.mark.parametrize("stop", [KeyboardInterrupt, SystemExit])
def test_who_wants_to_stop_can(stop):
    with pytest.raises(stop):
        ask(safe(stop()))


def test_slots_that_did_not_report_count_as_empty_for_the_fallback():
    holes = np.zeros((2, 12), dtype=bool)
    holes[B, slot("S-left")] = True
    assert ask(safe(None), holes).tolist() == [2, 0]


def test_where_nothing_is_observed_the_plan_goes_on():
    controller = safe(None)
    holes = NETWORK.slot_mask.copy()
    holes[B] = False
    phases = [ask(controller, holes, step).tolist() for step in range(5)]
    assert phases == [[0, 2], [1, 2], [2, 2], [3, 2], [0, 2]]
    assert controller.fallback_steps == 10


def test_the_first_few_distinct_errors_are_kept_and_name_the_place():
    errors = [ValueError("one"), ValueError("one"), KeyError("two"), OSError("3"), OSError("4")]

    def fail(observation):
        raise errors[observation.step]

    controller = safe(fail)
    for step in range(5):
        ask(controller, step=step)
    first, second, third = controller.last_error.split("; ")
    assert first.startswith("ValueError: one (test_fallback.py:")
    assert first.endswith(" in fail)")
    assert second.startswith("KeyError: 'two'")
    assert third.startswith("OSError: 3")
    controller.reset(context(NETWORK))
    assert (controller.last_error, controller.fallback_steps) == ("", 0)


def test_a_controller_cannot_change_what_others_see():
    def vandal(observation):
        observation.values[:] = 0
        observation.phase[:] = 3
        raise RuntimeError

    observation = observe(NETWORK, queue=QUEUES)
    assert safe(vandal).decide(observation).tolist() == FALLBACK
    assert observation.phase.tolist() == [-1, -1]
    assert observation.values.sum() == 10


def test_estimates_are_those_of_an_answer_that_was_used():
    controller = safe(np.array([3, 1]))
    inner = controller.controller
    inner.estimate = np.ones((2, 12, 2))
    assert controller.estimates() is None
    ask(controller)
    assert controller.estimates() is inner.estimate
    inner.estimate = np.ones((2, 12))
    assert controller.estimates() is None
    inner.estimate = RuntimeError("lost")
    assert controller.estimates() is None
    inner.answer, inner.estimate = None, np.ones((2, 12, 2))
    ask(controller)
    assert controller.estimates() is None


def test_an_error_in_reset_is_not_hidden():
    class Broken(Scripted):
        def reset(self, context):
            raise RuntimeError("no weights")

    with pytest.raises(RuntimeError, match="no weights"):
        Safe(Broken(), 1.0).reset(context(NETWORK))


class Nasty:
    def __array__(self, *args, **kwargs):
        raise RuntimeError("nothing to see")

    def __repr__(self):
        raise RuntimeError("not even a name")


class NastyError(Exception):
    def __str__(self):
        raise RuntimeError("not even a text")


SHAPES = hnp.array_shapes(min_dims=0, max_dims=2, min_side=0, max_side=3) | st.just((2,))
DTYPES = st.sampled_from(["i1", "i8", "u8", "f2", "f4", "f8", "c16", "?", "U2", "M8[s]", "m8[s]"])
ANSWERS = st.one_of(
    hnp.arrays(DTYPES, SHAPES),
    hnp.arrays(st.sampled_from(["i8", "f8"]), (2,)),
    st.lists(st.one_of(st.integers(), st.floats(), st.text(max_size=2), st.none()), max_size=3),
    st.builds(object),
    st.builds(Nasty),
    st.sampled_from([RuntimeError(), MemoryError(), RecursionError(), NastyError()]),
)


@settings(deadline=None)
@given(answer=ANSWERS, holes=hnp.arrays(bool, (2, 12)), step=st.integers(0, 1000))
def test_whatever_goes_in_legal_phases_come_out(answer, holes, step):
    controller = safe(answer)
    phases = ask(controller, holes & NETWORK.slot_mask, step)
    assert phases.shape == (2,)
    assert phases.dtype == np.int64
    assert NETWORK.phase_mask[[A, B], phases].all()
    assert (phases >= 0).all()
    assert (controller.fallback_steps == 0) == (controller.last_error == "")


@pytest.mark.parametrize("answer", [RuntimeError("lost"), np.array([-1, -1])])
def test_the_fallback_too_ends_a_red_where_a_sensor_is_silent(answer):
    holes = np.zeros((2, 12), dtype=bool)
    holes[A, slot("N-straight")] = True
    red = np.zeros((2, 12), dtype=np.int64)
    red[A, slot("N-straight")] = 8
    seen = with_holes(observe(NETWORK, queue=QUEUES), holes)
    observation = replace(seen, step=8, red_steps=red)
    for max_red, phases in ((0, FALLBACK), (135, FALLBACK), (134, [1, 2])):
        controller = Safe(Scripted(answer), 1.0, max_red=max_red)
        controller.reset(context(NETWORK))
        assert controller.decide(observation).tolist() == phases
