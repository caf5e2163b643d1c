"""Imputers that break the contract, one rule each, and the words that tell so."""

import numpy as np
import pytest

from tests.networks import grid_network, tee_network
from tsc_missing.imputation.check import check_imputer
from tsc_missing.imputation.last_value import LastValue
from tsc_missing.imputation.registry import IMPUTERS, make_imputer

NETWORK = grid_network(1, 2)


class Spoiled(LastValue):
    """What a function makes of the filled observation."""

    def __init__(self, spoil):
        self.spoil = spoil

    def fill(self, observation):
        return self.spoil(super().fill(observation))


class Scribbles(LastValue):
    def fill(self, observation):
        filled = super().fill(observation)
        observation.values[~observation.mask] = 0.0
        return filled


class Remembers(LastValue):
    def __init__(self):
        self.asked = 0

    def fill(self, observation):
        self.asked += 1
        filled = super().fill(observation)
        holes = ~observation.mask[:, :, None]
        return filled.filled(filled.values + holes * self.asked, filled.exits)


class Raises(LastValue):
    def fill(self, observation):
        raise ValueError("no idea")


@pytest.mark.parametrize("name", IMPUTERS)
@pytest.mark.parametrize("network", [NETWORK, tee_network()], ids=["grid", "tee"])
def test_shipped_imputers_conform(name, network):
    check_imputer(lambda: make_imputer(name), network)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Spoiled(lambda o: o.values), "must return an Observation"),
        (lambda: Spoiled(lambda o: o.filled(o.values + 1, o.exits)), "reported values as they are"),
        (lambda: Spoiled(lambda o: o.filled(o.values, o.exits + 1)), "reported exits as they are"),
        (lambda: Spoiled(lambda o: o.filled(o.values[:, :3], o.exits)), r"shape \(2, 12, 2\)"),
        (lambda: Spoiled(lambda o: o.filled(o.values * np.nan, o.exits)), "values must be finite"),
        (Scribbles, r"must not change observation\.values"),
        (Remembers, "after reset the same seed"),
        (Raises, r"at step 0 the imputer raised ValueError\('no idea'\)"),
    ],
)
def test_broken_imputers_are_told_why(make, words):
    with pytest.raises(AssertionError, match=words):
        check_imputer(make, NETWORK)
