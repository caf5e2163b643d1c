"""The method as published, under a name of its own."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch", reason="the diffusion controller needs torch")

import torch

from tests.controllers.helpers import cross_and_tee
from tests.controllers.planning import observations, save_tiny
from tests.diffusion.cases import PUBLISHED, history, model, plan
from tests.networks import context_for, grid_network
from tsc_missing.config import DiffusionSettings, MissingSettings, RunSettings, SignalSettings
from tsc_missing.controllers.blind import Blind
from tsc_missing.controllers.check import check_controller
from tsc_missing.controllers.difflight import DiffLight
from tsc_missing.controllers.registry import controller_of
from tsc_missing.controllers.resolved import weights_of
from tsc_missing.diffusion.config import DiffLightConfig
from tsc_missing.diffusion.weights import save_weights
from tsc_missing.errors import UserError
from tsc_missing.weights import find

GRID = grid_network(2, 3)


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    path = tmp_path_factory.mktemp("paper") / find.FILE
    save_weights(model(PUBLISHED), path, {})
    return path


def paper(weights, **options):
    diffusion = DiffusionSettings(weights=str(weights), sampling_steps=2)
    return controller_of(
        RunSettings(
            controller="difflight-paper",
            diffusion=diffusion,
            signals=SignalSettings(max_red=0),
            **options,
        )
    )


def test_it_conforms_and_decides_by_inverse_dynamics_everywhere(weights):
    check_controller(lambda: paper(weights), cross_and_tee())
    controller = paper(weights)
    assert isinstance(controller, DiffLight)  # no fixed cycle where nothing is seen
    by_inverse = DiffLight(weights, 2, "inverse")
    context = context_for(GRID)
    context = replace(context, sensors=context.sensors & (np.arange(6) > 1)[:, None])
    for one in (controller, by_inverse):
        one.reset(context)
    for observation in observations(GRID):
        np.testing.assert_array_equal(
            controller.decide(observation), by_inverse.decide(observation)
        )
    assert isinstance(paper(weights, blind="fixed-time"), Blind)


def test_other_weights_are_refused(tmp_path):
    path = save_tiny(tmp_path / find.FILE)
    with pytest.raises(UserError, match=r"weights of the method as published; .*--method paper"):
        paper(path)


def test_its_weights_are_those_of_the_network_and_pattern():
    def used(pattern, net="jinan", **diffusion):
        missing = MissingSettings(pattern=pattern, rate=0.0 if pattern == "none" else 0.1)
        settings = RunSettings(
            controller="difflight-paper", net=net, missing=missing, diffusion=diffusion
        )
        return weights_of(settings)

    assert used("kriging") == ("paper-jinan_1-kriging",)
    for pattern in ("none", "random", "lane"):
        assert used(pattern, "some/folder/hangzhou_2") == ("paper-hangzhou_2-random",)
    assert used("random", weights="mine-{net}") == ("mine-jinan_1",)


def test_what_makes_weights_that_are_not_there(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    for name, command in (
        ("strict-newyork_1-random", "tools.strict newyork_1 random`"),
        ("paper-jinan_9-kriging", "tools.strict jinan_9 kriging --method paper`"),
        ("ablation-unet", "tsc-train ablation-unet`"),
        ("strict", "tsc-train universal`"),
    ):
        with pytest.raises(UserError, match=command):
            find.find_weights(name)


def test_weights_of_a_training_are_found_by_its_name(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "runs" / "train-strict-here-random" / find.FILE
    path.parent.mkdir(parents=True)
    save_tiny(path)
    assert find.find_weights("strict-here-random").resolve() == path


@pytest.mark.parametrize("config", [PUBLISHED, DiffLightConfig()], ids=["published", "difflight"])
def test_only_what_was_added_reads_signals_and_roads_downstream(config):
    small = config.model_copy(update={"width": 16, "hidden": 16, "inverse_width": 16})
    made, present = model(small), history()
    plain = plan(made, present).future
    other = {
        "signals": replace(present, green=~present.green, red_steps=present.red_steps + 3),
        "downstream": replace(present, downstream=torch.full_like(present.downstream, -1)),
    }
    for name, changed in other.items():
        same = torch.equal(plan(made, changed).future, plain)
        assert same == config.is_published, name


def test_as_published_has_nothing_of_what_was_added():
    assert DiffLightConfig.as_published().is_published
    assert not DiffLightConfig().is_published
    for name in ("known_flag", "own_signals", "slot_identity", "downstream"):
        config = DiffLightConfig.as_published().model_copy(update={name: True})
        assert not config.is_published


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("noise_model", "unet"),
        ("padded_rewards", True),
        ("dcm", False),
        ("inverse_dynamics", False),
    ],
)
def test_a_part_of_the_method_is_not_the_method(name, value):
    assert not DiffLightConfig.as_published().model_copy(update={name: value}).is_published
