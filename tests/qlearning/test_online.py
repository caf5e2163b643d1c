import numpy as np
import pytest

pytest.importorskip("torch", reason="Q-networks need torch")

import torch

from tests.networks import grid_network
from tests.offline.cases import made_up_dataset
from tsc_missing.config import MissingSettings, RunSettings
from tsc_missing.errors import UserError
from tsc_missing.offline.log import read_log
from tsc_missing.qlearning.config import QLearningSettings
from tsc_missing.qlearning.learner import Learner
from tsc_missing.qlearning.networks import Graph
from tsc_missing.qlearning.online import EPISODES, QTraining, check_data
from tsc_missing.qlearning.replay import Replay
from tsc_missing.qlearning.weights import load_q_network
from tsc_missing.training.diverged import DivergedError

pytestmark = pytest.mark.usefixtures("one_worker")


def settings(small_net, **changes):
    values = {
        "algorithm": "advanced-colight",
        "nets": (str(small_net),),
        "demand": "recorded",
        "volume_min": 1,
        "volume_max": 1,
        "horizon": 150,
        "rounds": 3,
        "episodes": 1,
        "updates": 5,
        "batch": 24,
        "width": 8,
    }
    return QLearningSettings(**{**values, **changes})


@pytest.mark.parametrize("shape", [{}, {"algorithm": "value", "history": 3}], ids=str)
def test_stopped_and_gone_on_with_is_as_unbroken(small_net, tmp_path, shape):
    plan = settings(small_net, **shape)
    whole = QTraining(plan, tmp_path / "whole").run(1)
    rounds = []
    first = QTraining(plan, tmp_path / "broken")
    assert first.run(1, rounds.append, lambda: len(rounds) == 2) is None
    assert first.round == 2
    second = QTraining(plan, tmp_path / "broken", resume=True).run(1)
    (one, about), (other, _) = load_q_network(whole), load_q_network(second)
    assert about["updates"] == 15
    for name, weight in one.state_dict().items():
        assert torch.equal(weight, other.state_dict()[name]), name
    for file in (tmp_path / "whole" / EPISODES).iterdir():
        assert (
            read_log(file)[0].phase == read_log(tmp_path / "broken" / EPISODES / file.name)[0].phase
        ).all()


def test_learning_reduces_the_error(small_net, tmp_path):
    """Values of a fixed episode, without a future to guess."""
    training = QTraining(settings(small_net, rounds=1, updates=1, discount=0.0), tmp_path / "t")
    training.run(1)
    plan = settings(small_net, rounds=10, updates=30, discount=0.0, learning_rate=1e-2)
    log, about = read_log(tmp_path / "t" / EPISODES / "00000-0.parquet")
    from tsc_missing.evaluation.scenario import find_scenario

    network = find_scenario(about["net"], "recorded").folder.network
    replay = Replay({about["net"]: network}, plan, 5)
    replay.add(about["net"], log)
    torch.manual_seed(0)
    learner = Learner(plan, {about["net"]: Graph.of(network)})
    rng = np.random.default_rng(0)
    losses = [learner.update(replay.sample(24, rng)) for _ in range(300)]
    assert np.mean(losses[-30:]) < 0.3 * np.mean(losses[:10])


@pytest.mark.parametrize("weight", [0.0, 0.25, 1.0])
def test_rewards_are_of_the_step_after(small_net, tmp_path, weight):
    plan = settings(small_net, rounds=1, updates=1, running_weight=weight)
    training = QTraining(plan, tmp_path / "t")
    training.run(1)
    log, about = read_log(tmp_path / "t" / EPISODES / "00000-0.parquet")
    (batch,) = training._own.sample(10_000, np.random.default_rng(0))
    vehicles, queue = log.values.sum(axis=2)[1:].reshape(-1, 2).T
    possible = {
        round(-(float(q) + weight * float(v - q)) / 20, 4)
        for v, q in zip(vehicles, queue, strict=True)
    }
    assert {round(float(r), 4) for r in batch.reward.ravel()} <= possible
    assert about["net"] == str(small_net)


def test_killed_while_data_are_read(small_net, tmp_path, monkeypatch):
    def killed():
        raise KeyboardInterrupt

    plan, folder = settings(small_net, rounds=1), tmp_path / "t"
    training = QTraining(plan, folder)
    monkeypatch.setattr(training, "_load", killed)
    with pytest.raises(KeyboardInterrupt):
        training.run(1)
    with pytest.raises(UserError, match="--resume goes on"):
        QTraining(plan, folder)
    found = QTraining(plan, folder, resume=True).run(1)
    whole = QTraining(plan, tmp_path / "whole").run(1)
    one, other = (load_q_network(path)[0].state_dict() for path in (found, whole))
    assert all(torch.equal(one[name], other[name]) for name in one)


def test_killed_before_anything_was_saved(small_net, tmp_path):
    folder = tmp_path / "t"
    (folder / EPISODES).mkdir(parents=True)
    (folder / ".checkpoint.safetensors.123").write_text("{}")
    with pytest.raises(UserError, match="without --resume one begins"):
        QTraining(settings(small_net), folder, resume=True)
    QTraining(settings(small_net), folder)
    assert not [path for path in folder.rglob("*") if path.is_file()]


def test_what_can_be_wrong(small_net, tmp_path):
    plan = settings(small_net, rounds=1)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "x").touch()
    with pytest.raises(UserError, match="it is there already"):
        QTraining(plan, tmp_path / "full")
    QTraining(plan, tmp_path / "t").run(1)
    with pytest.raises(UserError, match="was begun with"):
        QTraining(settings(small_net, rounds=1, discount=0.5), tmp_path / "t", resume=True)
    inputs = tmp_path / "t" / "inputs.json"
    inputs.write_text(inputs.read_text().replace('/net.net.xml": "', '/net.net.xml": "0'))
    with pytest.raises(UserError, match=r"net\.net\.xml has changed since it was begun"):
        QTraining(plan, tmp_path / "t", resume=True)
    with pytest.raises(ValueError, match="need data"):
        settings(small_net, before=3)
    assert RunSettings().steps == 240


def test_beginning_with_weights(small_net, tmp_path):
    first = QTraining(settings(small_net, rounds=1, updates=1), tmp_path / "t").run(1)
    again = QTraining(settings(small_net, start=str(first)), tmp_path / "u")
    wanted, _ = load_q_network(first)
    for name, weight in again.learner.network.state_dict().items():
        assert torch.equal(weight, wanted.state_dict()[name])
    with pytest.raises(UserError, match="its width is 8"):
        QTraining(settings(small_net, start=str(first), width=12), tmp_path / "v")


def test_beginning_with_weights_that_look_less_far_back(small_net, tmp_path):
    plan = settings(small_net, algorithm="value", history=1, rounds=1, updates=1)
    first = QTraining(plan, tmp_path / "t").run(1)
    further = settings(small_net, algorithm="value", history=2, start=str(first), rounds=1)
    last, manifest = load_q_network(QTraining(further, tmp_path / "u").run(1))
    assert (last.history, manifest["history"]) == (2, 2)
    start = str(tmp_path / "u")
    with pytest.raises(UserError, match="its history is 2"):
        QTraining(plan.model_copy(update={"start": start}), tmp_path / "v")
    with pytest.raises(ValueError, match="advanced-colight does not look back"):
        settings(small_net, history=1)


def test_data_must_be_whole_and_of_the_same_networks(tmp_path):
    network, lost = grid_network(2, 2), MissingSettings(pattern="random", rate=0.3)
    whole = made_up_dataset(tmp_path / "whole", {"a": network})
    check_data(whole, "value", {"a": network, "b": grid_network(1, 2)})
    with pytest.raises(UserError, match=r"data: .*whole .* its a is another network than"):
        check_data(whole, "value", {"a": grid_network(1, 2)})
    holes = made_up_dataset(tmp_path / "holes", {"a": network}, holes=0.3, missing=lost)
    with pytest.raises(UserError, match=r"data: .*holes .* have holes, and value needs all"):
        check_data(holes, "value", {"a": network})


def test_a_training_that_diverges_writes_no_weights(small_net, tmp_path):
    plan = settings(small_net, rounds=1, learning_rate=1e30)
    with pytest.raises(DivergedError):
        QTraining(plan, tmp_path / "t").run(1)
    assert not (tmp_path / "t" / "weights.safetensors").exists()


def test_a_full_disk_is_one_line(small_net, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tsc_missing.qlearning.online.write_inputs", full)
    with pytest.raises(UserError, match=r"out: .* \(No space left on device\); .* --resume"):
        QTraining(settings(small_net, rounds=1), tmp_path / "t").run(1)
