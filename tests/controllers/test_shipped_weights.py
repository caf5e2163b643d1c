"""What the weights that come with the package are, and decide."""

import numpy as np
import pytest

pytest.importorskip("torch")

from tests.controllers.planning import observations
from tests.networks import context_for, grid_network
from tsc_missing.baselines.config import SETTINGS as BASELINES
from tsc_missing.config import RunSettings
from tsc_missing.controllers.registry import controller_of
from tsc_missing.weights.file import read_tensors
from tsc_missing.weights.find import FOLDER, find_weights, packaged_weights

GRID = grid_network(2, 3)
GOLDEN_VALUES = [
    [2, 1, 1, 1, 2, 3],
    [1, 2, 1, 0, 3, 0],
    [0, 2, 2, 1, 3, 0],
    [3, 2, 1, 2, 2, 0],
    [0, 2, 1, 1, 2, 2],
    [3, 1, 3, 2, 2, 1],
    [0, 2, 2, 0, 2, 0],
    [1, 1, 1, 0, 2, 3],
]
GOLDEN = [
    [3, 0, 1, 3, 2, 1],
    [1, 1, 0, 0, 2, 1],
    [0, 1, 1, 1, 3, 0],
    [1, 1, 1, 0, 3, 0],
    [0, 1, 0, 1, 1, 2],
    [0, 0, 0, 2, 2, 0],
    [0, 0, 2, 3, 2, 0],
    [0, 1, 2, 3, 3, 2],
]
NEAR_TIES = 2  # decisions that another processor's rounding of bf16 may turn
LARGEST = 3e6  # [bytes] of a file


def decisions(name, **options):
    controller = controller_of(RunSettings(controller=name, **options))
    controller.reset(context_for(GRID))
    return np.array([controller.decide(observation) for observation in observations(GRID)])


def test_golden_decisions():
    found = decisions("difflight")
    assert found.shape == (8, 6)
    assert (found != np.array(GOLDEN)).sum() <= NEAR_TIES


def test_golden_decisions_by_values():
    found = decisions("difflight", diffusion={"scoring": "value"})
    assert (found != np.array(GOLDEN_VALUES)).sum() <= NEAR_TIES


def test_the_default_is_difflight():
    assert RunSettings().controller == "difflight"
    assert RunSettings().diffusion.weights in packaged_weights()


@pytest.mark.parametrize("name", packaged_weights())
def test_weights_say_where_they_come_from(name):
    path = find_weights(name)
    assert path.is_relative_to(FOLDER)
    assert path.stat().st_size < LARGEST
    baseline = max((b for b in BASELINES if name.startswith(f"{b}-")), key=len, default=None)
    strict = name.startswith(("strict-", "paper-"))  # learned from a recorded flow, with holes
    kind = "q-network"
    if baseline or strict or name.startswith("universal"):
        kind = "baseline" if baseline else "difflight"
    manifest, tensors = read_tensors(path, kind)
    assert tensors
    assert {"training", "versions", "git", "checksum"} <= manifest.keys()
    if baseline:  # of one network each, whose recorded demand they may have seen
        assert manifest["algorithm"] == baseline
        assert manifest["data"]["sources"].keys() == {name.removeprefix(f"{baseline}-")}
        return
    data = manifest["data"] if kind == "difflight" else manifest
    sources = data.get("sources") or {
        f"{net} of {number}": files
        for number, part in enumerate(data["joined"])
        for net, files in part["sources"].items()
    }
    if strict:
        assert list(sources) == [name.split("-")[1]]
        assert not manifest["data"]["complete"]
        assert manifest["data"]["settings"]["missing"]["pattern"] == name.split("-")[2]
        assert manifest["data"]["settings"]["demand"] == "recorded"
    else:
        assert not any("recorded" in file for files in sources.values() for file in files)
