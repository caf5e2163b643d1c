"""What every baseline must do: one tester that all of them pass."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch", reason="the baselines need torch")

import torch
from safetensors.torch import load_file

from tests.baselines.cases import NETWORKS, queue_dataset, tiny, trained
from tests.controllers.helpers import cross_and_tee
from tests.controllers.planning import observations
from tests.networks import context_for, grid_network, tee_network
from tsc_missing.baselines.config import SETTINGS
from tsc_missing.baselines.controller import make_baseline
from tsc_missing.baselines.loop import BaselineTraining
from tsc_missing.baselines.registry import LEARNERS, make_learner
from tsc_missing.baselines.weights import KIND, load_policy
from tsc_missing.controllers.check import check_controller
from tsc_missing.controllers.registry import make_controller
from tsc_missing.errors import UserError
from tsc_missing.training import checkpoint
from tsc_missing.training.config import read_training
from tsc_missing.training.diverged import DivergedError
from tsc_missing.training.steps import StoppedError
from tsc_missing.weights.file import read_tensors

every_baseline = pytest.mark.parametrize("name", SETTINGS)
OTHER_NETWORKS = {"2 x 3": grid_network(2, 3), "tee": tee_network(), "two": cross_and_tee()}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return queue_dataset(tmp_path_factory.mktemp("data") / "d", episodes=6)


@pytest.fixture(scope="module")
def weights(dataset, tmp_path_factory):
    """Of each baseline, trained once."""
    folder = tmp_path_factory.mktemp("weights")
    return {name: trained(name, dataset, folder / name)[1] for name in SETTINGS}


def decisions(controller, network, poison=None):
    """The phases of a run of observations; half of the values are missing, or ``poison``."""
    controller.reset(context_for(network))
    return np.array([controller.decide(seen) for seen in observations(network, poison)])


def filled(network):
    """Observations without holes."""
    return [replace(o, values=np.nan_to_num(o.values)) for o in observations(network)]


def test_all_are_there():
    assert SETTINGS.keys() == LEARNERS.keys()
    for name in SETTINGS:
        assert read_training(name).algorithm == name


@every_baseline
@pytest.mark.parametrize("network", OTHER_NETWORKS.values(), ids=OTHER_NETWORKS)
def test_legal_phases_on_networks_that_it_has_not_seen(weights, name, network):
    path = str(weights[name])
    check_controller(lambda: make_controller(name, "sfm", "none", q_weights=path), network)


@every_baseline
def test_what_is_under_the_holes_changes_no_decision(weights, name):
    network = OTHER_NETWORKS["tee"]
    runs = [
        decisions(make_controller(name, "sfm", "none", q_weights=str(weights[name])), network, it)
        for it in (None, 0.0, 1e6)
    ]
    np.testing.assert_array_equal(runs[0], runs[1])
    np.testing.assert_array_equal(runs[0], runs[2])


@every_baseline
def test_without_an_imputer_a_hole_is_an_error(weights, name):
    controller = make_baseline(name, weights[name])
    network = OTHER_NETWORKS["tee"]
    controller.reset(context_for(network))
    first = next(iter(observations(network)))
    assert np.isnan(first.values).any()
    with pytest.raises(ValueError, match=f"{name} needs an imputer"):
        controller.decide(first)


@every_baseline
def test_decides_by_what_it_sees(weights, name):
    """Not always the same: other queues, other phases."""
    network = OTHER_NETWORKS["2 x 3"]
    controller = make_baseline(name, weights[name])
    controller.reset(context_for(network))
    found = np.array([controller.decide(seen) for seen in filled(network)])
    assert len(np.unique(found, axis=0)) > 1


@every_baseline
def test_the_learner_and_its_weights_give_the_same_scores(dataset, name, tmp_path):
    training, path = trained(name, dataset, tmp_path / "t")
    policy, settings, manifest = load_policy(path)
    batch = next(training._held_out.spread())
    mine, other = (
        p.scores(batch, torch.Generator().manual_seed(3)) for p in (training.learner.policy, policy)
    )
    torch.testing.assert_close(mine, other, rtol=0, atol=0)
    assert settings == training.settings.model_copy(update={"data": settings.data})
    assert manifest["algorithm"] == name
    assert manifest["data"]["checksum"] == dataset.checksum
    assert manifest["steps"] == 12
    assert manifest["wall_seconds"] > 0
    assert 0 <= manifest["held_out"]["accuracy"] <= 1
    assert {"versions", "git", "seed", "checksum"} <= manifest.keys()
    assert str(tmp_path) not in json.dumps(manifest)
    assert str(dataset.path) not in json.dumps(manifest)


@every_baseline
def test_resumed_training_equals_an_unbroken_one(dataset, name, tmp_path):
    settings = tiny(name, dataset.path)
    whole = load_file(BaselineTraining(settings, dataset, tmp_path / "whole").run())
    for step in (3, 7):
        training = BaselineTraining(settings, dataset, tmp_path / "broken", resume=step > 3)
        with pytest.raises(StoppedError, match=f"step {step}"):
            training.run(stop=lambda t=training, s=step: t.step == s)
    broken = load_file(BaselineTraining(settings, dataset, tmp_path / "broken", resume=True).run())
    states = [load_file(tmp_path / part / checkpoint.FILE) for part in ("whole", "broken")]
    for one, other in ((whole, broken), states):
        assert one.keys() == other.keys()
        for key, tensor in one.items():
            assert torch.equal(tensor, other[key]), key
    for part in ("whole", "broken"):
        with (tmp_path / part / "metrics.csv").open() as stream:
            rows = list(csv.DictReader(stream))
        assert [row["step"] for row in rows] == ["4", "8", "12"]
        assert all(float(row["held_out_accuracy"]) >= 0 for row in rows)


@every_baseline
def test_updates_change_every_weight_that_decides(dataset, name, tmp_path):
    """Nothing is left out of the optimisers."""
    torch.manual_seed(0)
    training = BaselineTraining(tiny(name, dataset.path, steps=40), dataset, tmp_path / "t")
    before = {key: t.clone() for key, t in training.learner.policy.state_dict().items()}
    training.run()
    same = [k for k, t in training.learner.policy.state_dict().items() if torch.equal(t, before[k])]
    assert not same


@every_baseline
def test_nan_stops_with_the_step(dataset, name, tmp_path):
    training = BaselineTraining(tiny(name, dataset.path), dataset, tmp_path / "t")
    run = training.train_step

    def poisoned():
        if training.step == 6:
            with torch.no_grad():
                for weight in training.learner.parameters():
                    weight.fill_(torch.nan)
        return run()

    training.train_step = poisoned
    with pytest.raises(DivergedError, match="at step 6 the loss is nan"):
        training.run()
    assert not (tmp_path / "t" / "weights.safetensors").exists()
    _, tensors = checkpoint.load_checkpoint(tmp_path / "t" / checkpoint.FILE)
    assert all(tensor.isfinite().all() for tensor in tensors.values())


@every_baseline
def test_logs_with_holes(name, tmp_path):
    holes = queue_dataset(tmp_path / "d", episodes=4, holes=0.3)
    if make_learner(tiny(name, holes.path)).takes_holes:
        _, path = trained(name, holes, tmp_path / "t")
        assert not load_policy(path)[2]["data"]["complete"]
        return
    with pytest.raises(UserError, match="its logs have holes") as caught:
        trained(name, holes, tmp_path / "t")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "t").exists()


def test_what_was_begun_otherwise_is_refused(dataset, tmp_path):
    trained("bc", dataset, tmp_path / "a")
    with pytest.raises(UserError, match="--resume"):
        BaselineTraining(tiny("bc", dataset.path), dataset, tmp_path / "a")
    with pytest.raises(UserError, match=r"width: 12 .* begun with 8"):
        BaselineTraining(tiny("bc", dataset.path, width=12), dataset, tmp_path / "a", True)
    other = queue_dataset(tmp_path / "o", networks={"one": grid_network(1, 1)}, episodes=2)
    with pytest.raises(UserError, match="another dataset"):
        BaselineTraining(tiny("bc", other.path), other, tmp_path / "a", True)
    path = tmp_path / "a" / checkpoint.FILE
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(UserError, match="cut off"):
        BaselineTraining(tiny("bc", dataset.path), dataset, tmp_path / "a", True)


def test_one_episode_is_not_enough(tmp_path):
    one = queue_dataset(tmp_path / "d", networks={"tee": NETWORKS["tee"]}, episodes=1)
    with pytest.raises(UserError, match="two episodes"):
        trained("bc", one, tmp_path / "t")
    short = queue_dataset(  # one of an episode's one step, and one of two
        tmp_path / "s", networks={"tee": NETWORKS["tee"]}, episodes=2, steps=1
    )
    with pytest.raises(UserError, match="no episode has 2 steps"):
        trained("cql", short, tmp_path / "t")


def test_weights_of_others(weights, tmp_path):
    with pytest.raises(UserError, match="they are of bc, not of cql"):
        make_baseline("cql", weights["bc"])
    cut = tmp_path / "cut.safetensors"
    cut.write_bytes(weights["bc"].read_bytes()[:-9])
    with pytest.raises(UserError, match="cut off"):
        load_policy(cut)
    manifest, tensors = read_tensors(weights["bc"], KIND)
    from tsc_missing.weights.file import write_tensors

    write_tensors(tmp_path / "x", KIND, tensors, {**manifest, "algorithm": "cq"})
    with pytest.raises(UserError, match="knows no baseline cq"):
        load_policy(tmp_path / "x")
    write_tensors(tmp_path / "x", KIND, tensors, {**manifest, "features": ["queue"]})
    with pytest.raises(UserError, match="other features"):
        load_policy(tmp_path / "x")
    write_tensors(tmp_path / "x", KIND, {}, manifest)
    with pytest.raises(UserError, match="not those of its algorithm"):
        load_policy(tmp_path / "x")
    write_tensors(tmp_path / "x", "q-network", tensors, manifest)
    with pytest.raises(UserError, match="weights of kind q-network, not baseline"):
        load_policy(tmp_path / "x")
