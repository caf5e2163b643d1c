"""Controllers that break the contract, one rule each, and the words that tell so."""

import numpy as np
import pytest

from tests.controllers.helpers import Scripted, cross_and_tee
from tsc_missing.controllers.check import check_controller
from tsc_missing.controllers.max_queue import MaxQueue
from tsc_missing.controllers.random_phases import RandomPhases


def zeros(observation):
    return np.zeros(len(observation.phase), dtype=np.int64)


def scribbles(observation):
    observation.red_steps[0, 0] += 1
    return zeros(observation)


class Counting(Scripted):
    """Never forgets."""

    def decide(self, observation):
        self.asked += 1
        return zeros(observation) + self.asked % 2


class OneSeedEach(Scripted):
    """Draws from a generator that is its own."""

    made = 0

    def reset(self, context):
        if not hasattr(self, "seed"):
            OneSeedEach.made += 1
            self.seed = OneSeedEach.made
        self.random = np.random.default_rng(self.seed)

    def decide(self, observation):
        return self.random.integers(0, 3, len(observation.phase))


class WrongEstimates(Scripted):
    def estimates(self):
        return np.zeros((2, 12))


@pytest.mark.parametrize("make", [RandomPhases, lambda: Scripted(zeros)])
def test_good_controllers_pass(make):
    check_controller(make, cross_and_tee())


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Scripted([0, 0]), "must return a NumPy array"),
        (lambda: Scripted(np.zeros(3, dtype=int)), r"must return the shape \(2,\), not \(3,\)"),
        (lambda: Scripted(np.zeros(2)), "must return integers, not float64"),
        (
            lambda: Scripted(np.array([0, 3])),
            "at intersection B must be .* 3 phases, 0 to 2, not 3",
        ),
        (
            lambda: Scripted(np.array([-1, 0])),
            "at intersection A must be .* 4 phases, 0 to 3$",
        ),
        (lambda: Scripted(scribbles), "must not change observation.red_steps"),
        (Counting, "after reset the same seed"),
        (OneSeedEach, "two controllers with the same seed"),
        (lambda: WrongEstimates(zeros), r"estimates\(\) must be None or an array of the shape"),
        (MaxQueue, "at step 0 the controller raised ValueError.*needs an imputer"),
        (lambda: Scripted(RuntimeError("lost")), "raised RuntimeError"),
    ],
)
def test_bad_controllers_fail_with_words(make, words):
    with pytest.raises(AssertionError, match=words):
        check_controller(make, cross_and_tee())
