import importlib.util

import numpy as np
import pytest

from tests.controllers.helpers import context, cross_and_tee, observe
from tests.networks import grid_network, tee_network
from tsc_missing.config import DiffusionSettings, RunSettings
from tsc_missing.controllers.blind import Blind
from tsc_missing.controllers.catalogue import (
    CONTROLLERS,
    FULL_INFORMATION,
    LEARNED,
    NATIVE,
    looks_at_nothing,
    needs_values,
)
from tsc_missing.controllers.check import check_controller
from tsc_missing.controllers.max_red import MaxRed
from tsc_missing.controllers.registry import BLIND, make_controller
from tsc_missing.controllers.resolved import resolved
from tsc_missing.controllers.rolling_horizon import RollingHorizon
from tsc_missing.controllers.spillback import Spillback
from tsc_missing.errors import UserError
from tsc_missing.imputation.base import Imputed

DEFAULTS = RunSettings()
BUILDS = [lambda: grid_network(1, 2), tee_network, cross_and_tee]
PLENTY = 40  # [vehicles a lane] so much that some slots of these networks are always filling
needs_torch = pytest.mark.skipif(
    importlib.util.find_spec("torch") is None, reason="Q-networks need torch"
)
COMPOSED = [name for name in CONTROLLERS if needs_values(name)]
COMPOSED += [pytest.param(name, marks=needs_torch) for name in LEARNED]


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("build", BUILDS)
@pytest.mark.parametrize("blind", ["none", "fixed-time"])
def test_every_controller_conforms(name, build, blind):
    check_controller(lambda: make_controller(name, DEFAULTS.imputer, blind), build())


@pytest.mark.usefixtures("weights_read_once")
@pytest.mark.parametrize("name", COMPOSED)
@pytest.mark.parametrize("build", BUILDS)
@pytest.mark.parametrize("blind", BLIND)
def test_every_composition_conforms(name, build, blind):
    def make():
        return make_controller(name, DEFAULTS.imputer, blind, max_red=60, min_space=PLENTY)

    check_controller(make, build())


def test_controllers_that_need_values_get_an_imputer_and_the_rule_for_blind_intersections():
    controller = make_controller("max-queue", "last", "fixed-time")
    assert isinstance(controller, Blind)
    assert isinstance(controller.controller, Imputed)
    assert isinstance(make_controller("max-queue", "last", "none"), Imputed)


def test_the_default_settings_can_be_had():
    make_controller(DEFAULTS.controller, DEFAULTS.imputer, DEFAULTS.blind)


def test_what_the_default_settings_are_in_a_run():
    turns = ["lookahead", "lookahead-second", "lookahead-first"]
    shipped = {"min_space": 3, "sampling_steps": [3, 8], "weights": ["universal"]}
    assert resolved(DEFAULTS) == {"blind": "alone", **shipped}
    values = RunSettings(diffusion={"scoring": "value"})
    roomy = {"min_space": 9, "weights": ["universal", *turns]}
    assert resolved(values) == {"blind": "clustered", **shipped, **roomy}
    given = values.model_copy(update={"q_weights": "lookahead, mine"})
    assert resolved(given)["weights"] == ["universal", "lookahead", "mine"]
    inverse = RunSettings(diffusion={"scoring": "inverse"})
    guided = {"min_space": 0, "sampling_steps": [10, 10], "weights": ["universal"]}
    assert resolved(inverse) == {"blind": "fixed-time", **guided}
    rule = RunSettings(controller="max-queue", blind="none")
    assert resolved(rule) == {
        "blind": "none",
        "min_space": 0,
        "sampling_steps": [3, 8],
        "weights": [],
    }


@pytest.mark.parametrize(
    ("given", "rule"),
    [
        ({}, "alone"),
        ({"controller": "rolling-horizon"}, "alone"),
        ({"diffusion": {"scoring": "value"}}, "clustered"),
        ({"diffusion": {"scoring": "value"}, "imputer": "diffusion"}, "clustered"),
        ({"diffusion": {"scoring": "queue"}}, "fixed-time"),
        ({"controller": "max-queue"}, "fixed-time"),
        ({"controller": "max-queue", "imputer": "diffusion"}, "familiar"),
        ({"controller": "bc", "imputer": "diffusion"}, "familiar"),
        ({"controller": "difflight-paper", "imputer": "diffusion"}, "none"),
        ({"controller": "actuated-recall"}, "none"),
    ],
    ids=str,
)
def test_what_runs_at_blind_intersections_goes_by_what_fills_holes(given, rule):
    assert resolved(RunSettings(**given))["blind"] == rule


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("max-que", "sfm", "none"), "controller: max-que is not allowed; did you mean max-queue?"),
        (("actuate", "sfm", "none"), "did you mean actuated?"),
        (("max-queue", "sfm", "fixed"), "blind: fixed is not allowed;"),
    ],
)
def test_unknown_names(names, words):
    with pytest.raises(UserError, match=words.replace("?", r"\?")):
        make_controller(*names)


def test_native_programs_are_no_controllers():
    assert not set(NATIVE) & set(CONTROLLERS)
    assert set(FULL_INFORMATION) == {name for name in NATIVE if looks_at_nothing(name)}


def test_random_takes_every_phase_that_is_there_about_equally_often():
    network = cross_and_tee()
    controller = make_controller("random", "sfm", "none")
    controller.reset(context(network))
    run = np.array([controller.decide(observe(network, step=step)) for step in range(1200)])
    counts = np.array([np.bincount(run[:, n], minlength=4) for n in range(2)])
    np.testing.assert_allclose(counts / 1200, [[0.25] * 4, [1 / 3] * 3 + [0]], atol=0.05)


@needs_torch
@pytest.mark.parametrize(
    ("name", "command"),
    [
        ("attendlight", "tsc-train attendlight"),
        ("bc", "tsc-train bc --data data/jinan_1"),
    ],
)
def test_weights_of_a_policy_that_are_not_there_name_what_makes_such(name, command):
    with pytest.raises(UserError, match=f"`{command}` makes some"):
        make_controller(name, "sfm", "none", q_weights="nowhere", net="jinan_1")


@needs_torch
def test_values_that_are_not_there_name_what_makes_such():
    by_value = DiffusionSettings(scoring="value")
    with pytest.raises(UserError, match="`tsc-train lookahead` makes some"):
        make_controller("difflight", "sfm", "none", by_value, q_weights="nowhere")


def test_a_plan_on_a_traffic_model_has_the_rules_that_are_asked_for():
    assert isinstance(make_controller("rolling-horizon", "sfm", "none"), RollingHorizon)
    plain = make_controller("rolling-horizon", "sfm", "auto")
    assert isinstance(plain, Blind)
    assert isinstance(plain.controller, RollingHorizon)
    kept = make_controller("rolling-horizon", "sfm", "fixed-time", max_red=240, min_space=4)
    assert isinstance(kept, Blind)
    assert isinstance(kept.controller, MaxRed)
    assert isinstance(kept.controller.controller, Spillback)


@needs_torch
def test_weights_that_are_known_but_not_shipped_are_no_mistake_in_the_name():
    with pytest.raises(
        UserError, match=r"are not in the package; `python -m tools\.strict jinan_2"
    ):
        make_controller(
            "difflight", "sfm", "none", DiffusionSettings(weights="strict-jinan_2-random")
        )
