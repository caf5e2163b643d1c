"""From a controller's name and a network to the weights of a baseline."""

import shutil

import pytest

pytest.importorskip("torch", reason="the baselines need torch")

from tests.baselines.cases import queue_dataset, trained
from tsc_missing.baselines.controller import BaselineController
from tsc_missing.batch.check import available
from tsc_missing.batch.suite import read_suite
from tsc_missing.config import RunSettings, SignalSettings
from tsc_missing.controllers.registry import controller_of
from tsc_missing.controllers.resolved import uses_weights, weights_of
from tsc_missing.errors import UserError
from tsc_missing.imputation.base import Imputed

SUITE = """
[methods.BC]
controller = "bc"
imputer = "sfm"
blind = "none"
train = "tsc-train bc"
[methods.Own]
controller = "bc"
q_weights = "{own}"
[[runs]]
method = ["BC", "Own"]
net = ["jinan", "jinan_2"]
"""


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package that comes with weights of bc for jinan_1 only."""
    data = queue_dataset(tmp_path / "d", episodes=4)
    _, weights = trained("bc", data, tmp_path / "t")
    (tmp_path / "package" / "bc-jinan_1").mkdir(parents=True)
    shutil.copy(weights, tmp_path / "package" / "bc-jinan_1")
    monkeypatch.setattr("tsc_missing.weights.find.FOLDER", tmp_path / "package")
    return tmp_path


@pytest.mark.parametrize("net", ["jinan", "jinan_1", "some/folder/jinan_1"])
def test_packaged_weights_are_found_by_controller_and_network(package, net):
    signals = SignalSettings(max_red=0)
    settings = RunSettings(controller="bc", net=net, imputer="sfm", blind="none", signals=signals)
    assert weights_of(settings) == ("bc-jinan_1",)
    assert uses_weights(settings)
    controller = controller_of(settings)
    assert isinstance(controller, Imputed)
    assert isinstance(controller.controller, BaselineController)


def test_a_network_without_packaged_weights_says_what_makes_them(package):
    with pytest.raises(UserError) as caught:
        controller_of(RunSettings(controller="bc", net="jinan_2"))
    assert str(caught.value) == (
        "q_weights: bc-jinan_2 are not in the package; `tsc-train bc --data data/jinan_2` makes "
        "them, and --policy-weights runs/train-bc-jinan_2 uses them"
    )


def test_a_baseline_that_learns_from_holes_is_found_where_its_command_leaves_it():
    settings = RunSettings(controller="cql-model-based", net="jinan_2")
    with pytest.raises(UserError, match="data/strict-jinan_2-random` makes") as caught:
        controller_of(settings)
    assert "runs/train-cql-model-based-strict-jinan_2-random uses them" in str(caught.value)


def test_own_weights_go_before_packaged_ones_and_may_name_the_network(package):
    mine = str(package / "t")
    settings = RunSettings(controller="bc", net="jinan_2", q_weights=mine)
    assert weights_of(settings) == (mine,)
    controller_of(settings)
    settings = RunSettings(controller="bc", net="jinan", q_weights="runs/train-bc-{net}")
    assert weights_of(settings) == ("runs/train-bc-jinan_1",)
    with pytest.raises(UserError, match="runs/train-bc-jinan_1 is not allowed"):
        controller_of(settings)


def test_a_suite_runs_where_there_are_weights_and_names_where_there_are_none(package):
    path = package / "s.toml"
    (package / "runs-jinan_1").mkdir()
    shutil.copy(package / "t" / "weights.safetensors", package / "runs-jinan_1")
    path.write_text(SUITE.format(own=package / "runs-{net}"))
    suite = read_suite(str(path))
    with pytest.raises(UserError, match="tsc-train bc --data data/jinan_2") as caught:
        available(suite.runs, skip=False)
    assert "jinan_1" not in str(caught.value)
    there, lacking = available(suite.runs, skip=True)
    assert [(run.method, run.dataset) for run in there] == [("BC", "jinan_1"), ("Own", "jinan_1")]
    assert lacking == {
        "BC on jinan_2": "tsc-train bc --data data/jinan_2",
        "Own on jinan_2": "tsc-train bc --data data/jinan_2",
    }
