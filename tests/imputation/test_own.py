"""What becomes of the answers of imputers and controllers of users' own."""

import numpy as np
import pytest

from tests.controllers.helpers import A, context, cross_and_tee, observe, slot, with_holes
from tests.networks import sharing_lanes
from tsc_missing.controllers.own import OwnController
from tsc_missing.controllers.spillback import Spillback
from tsc_missing.imputation.check import check_imputer
from tsc_missing.imputation.own import OwnImputer

NETWORK = cross_and_tee()
FILE = """
from dataclasses import replace

import numpy as np

from tsc_missing.controllers.max_queue import MaxQueue
from tsc_missing.imputation.base import Imputer


class Zeros(Imputer):
    def reset(self, context):
        pass

    def fill(self, observation):
        numbers = (np.nan_to_num(part) for part in (observation.values, observation.exits))
        return self.change(observation.filled(*numbers))

    def change(self, filled):
        return filled


class Broadcasts(Zeros):
    def change(self, filled):
        return replace(filled, values=np.zeros((1, 12, 2)))


class Infinite(Zeros):
    def change(self, filled):
        return replace(filled, values=np.where(filled.mask[..., None], filled.values, np.inf))


class Narrow(Zeros):
    def change(self, filled):
        return replace(filled, exits=filled.exits[:, :1])


class Halves(Zeros):
    def change(self, filled):
        return replace(filled, values=filled.values / 2)


class Single(Zeros):
    def change(self, filled):
        parts = (part.astype(np.float32) for part in (filled.values, filled.exits))
        return filled.filled(*parts)


class Repaints(Zeros):
    def change(self, filled):
        return replace(
            filled, mask=filled.mask | True, phase=filled.phase * 0, red_steps=filled.red_steps + 9
        )


class Estimates(MaxQueue):
    needs_values = False

    def decide(self, observation):
        numbers = np.nan_to_num(observation.values)
        return super().decide(observation.filled(numbers, observation.exits))

    def estimates(self):
        return np.zeros(3)
"""


@pytest.fixture
def mine(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(FILE)
    return path


@pytest.fixture
def observation():
    holes = np.zeros((2, 12), dtype=bool)
    holes[A, slot("N-straight")] = True
    return with_holes(observe(NETWORK, queue={(A, "W-left"): 5}, phase=[3, 1]), holes)


def fill(path, name, observation):
    imputer = OwnImputer(f"{path}:{name}")
    imputer.reset(context(NETWORK))
    return imputer.fill(observation)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Broadcasts", r"values must have the shape \(2, 12, 2\), not \(1, 12, 2\)"),
        ("Infinite", "values must be finite everywhere"),
        ("Narrow", r"exits must have the shape \(2, 12\), not \(2, 1\)"),
        ("Halves", "fill must leave the reported values as they are"),
    ],
)
def test_an_answer_that_is_none_raises(mine, observation, name, words):
    with pytest.raises(ValueError, match=words):
        fill(mine, name, observation)


def test_only_numbers_are_taken_from_an_answer(mine, observation):
    plain, painted = (fill(mine, name, observation) for name in ("Zeros", "Repaints"))
    for name, value in vars(plain).items():
        np.testing.assert_array_equal(getattr(painted, name), value)
    np.testing.assert_array_equal(painted.mask, observation.mask)
    assert np.isfinite(painted.values).all()


def test_single_precision_leaves_parts_of_vehicles_as_they_were(mine, observation):
    thirds = observation.filled(observation.values / 3, observation.exits / 3)
    filled = fill(mine, "Single", thirds)
    seen = np.isfinite(thirds.values)
    np.testing.assert_array_equal(filled.values[seen], thirds.values[seen])
    check_imputer(lambda: OwnImputer(f"{mine}:Single"), sharing_lanes(NETWORK))


def test_estimates_of_another_shape_cost_no_decision(mine, observation):
    own = OwnController(f"{mine}:Estimates")
    roomy = Spillback(own, 4)
    for controller in (own, roomy):
        controller.reset(context(NETWORK))
        assert controller.decide(observation)[A] == 2
        with pytest.raises(ValueError, match=r"estimates must have the shape \(2, 12, 2\), not"):
            controller.estimates()
