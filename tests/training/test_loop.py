import csv
import errno
import json
import re

import pytest

pytest.importorskip("torch", reason="the diffusion controller needs torch")

import torch
from safetensors.torch import load_file

from tests.diffusion.cases import TINY
from tests.networks import grid_network
from tests.offline.cases import made_up_dataset
from tsc_missing.diffusion.weights import load_weights
from tsc_missing.errors import UserError
from tsc_missing.paths import bundled_trainings
from tsc_missing.training import checkpoint
from tsc_missing.training.config import TrainingSettings, read_training
from tsc_missing.training.diverged import DivergedError
from tsc_missing.training.loop import Training
from tsc_missing.training.steps import StoppedError, learning_rate


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    networks = {"wide": grid_network(1, 3), "tall": grid_network(2, 1)}
    return made_up_dataset(tmp_path_factory.mktemp("data") / "d", networks, episodes=3)


@pytest.fixture
def settings(dataset):
    return TrainingSettings(
        data=dataset.path,
        model=TINY,
        batch=32,
        steps=12,
        warm_up=2,
        log_steps=3,
        resident=2,
        renew=2,
        precision="float32",
    )


def stop_at(training, step):
    return lambda: training.step == step


def run_until(settings, dataset, folder, step, resume=False):
    training = Training(settings, dataset, folder, resume)
    with pytest.raises(StoppedError, match=f"step {step}"):
        training.run(stop=stop_at(training, step))
    return training


def test_resumed_training_equals_an_unbroken_one(settings, dataset, tmp_path):
    whole = load_file(Training(settings, dataset, tmp_path / "whole").run())
    run_until(settings, dataset, tmp_path / "broken", 5)
    run_until(settings, dataset, tmp_path / "broken", 7, resume=True)
    broken = load_file(Training(settings, dataset, tmp_path / "broken", resume=True).run())
    assert whole.keys() == broken.keys()
    for name, tensor in whole.items():
        assert torch.equal(tensor, broken[name]), name
    for part in ("whole", "broken"):
        with (tmp_path / part / "metrics.csv").open() as stream:
            assert [row["step"] for row in csv.DictReader(stream)] == ["3", "6", "9", "12"]
    states = [load_file(tmp_path / part / checkpoint.FILE) for part in ("whole", "broken")]
    for name, tensor in states[0].items():
        assert torch.equal(tensor, states[1][name]), name


def test_weights_tell_where_they_come_from(settings, dataset, tmp_path):
    model, manifest = load_weights(Training(settings, dataset, tmp_path / "a").run())
    assert model.config == TINY
    assert manifest["steps"] == 12
    assert manifest["data"]["checksum"] == dataset.checksum
    assert manifest["data"]["complete"]
    assert manifest["training"]["masks"]["blind"] > 0
    assert manifest["wall_seconds"] > 0
    assert str(tmp_path) not in json.dumps(manifest)


def test_weights_are_trained_further(settings, dataset, tmp_path):
    first = Training(settings, dataset, tmp_path / "a").run()
    more = settings.model_copy(update={"begin": str(first), "steps": 4, "learning_rate": 1e-6})
    further, manifest = load_weights(Training(more, dataset, tmp_path / "b").run())
    begun, about = load_weights(first)
    assert manifest["begun_from"] == about["checksum"]
    assert about["begun_from"] is None
    assert str(tmp_path) not in json.dumps(manifest)
    before = begun.state_dict()
    for name, tensor in further.state_dict().items():
        torch.testing.assert_close(tensor, before[name], atol=1e-4, rtol=0)
    assert any(not torch.equal(x, before[name]) for name, x in further.state_dict().items())
    run_until(more, dataset, tmp_path / "c", 2)
    Training(settings.model_copy(update={"seed": 9}), dataset, tmp_path / "other").run()
    first.write_bytes((tmp_path / "other" / first.name).read_bytes())
    resumed, about_resumed = load_weights(
        Training(more, dataset, tmp_path / "c", resume=True).run()
    )
    for name, tensor in further.state_dict().items():
        assert torch.equal(tensor, resumed.state_dict()[name]), name
    assert about_resumed["begun_from"] == about["checksum"]


def test_weights_of_another_model_are_not_trained_further(settings, dataset, tmp_path):
    first = Training(settings, dataset, tmp_path / "a").run()
    wider = TINY.model_copy(update={"hidden": TINY.hidden * 2})
    other = settings.model_copy(update={"begin": str(first), "model": wider})
    with pytest.raises(UserError, match="another config"):
        Training(other, dataset, tmp_path / "b")
    with pytest.raises(UserError, match="nowhere"):
        Training(settings.model_copy(update={"begin": "nowhere"}), dataset, tmp_path / "b")


def test_a_training_of_an_older_version_goes_on(settings, dataset, tmp_path):
    run_until(settings, dataset, tmp_path / "a", 2)
    path = tmp_path / "a" / checkpoint.FILE
    at, tensors = checkpoint.load_checkpoint(path)
    known = {name: value for name, value in at.settings.items() if name != "begin"}
    checkpoint.write_checkpoint(path, tensors, at.model_copy(update={"settings": known}))
    assert Training(settings, dataset, tmp_path / "a", resume=True).step == 2


def test_a_training_learns(settings, dataset, tmp_path):
    longer = settings.model_copy(
        update={"steps": 80, "learning_rate": 1e-2, "log_steps": 10, "weight_decay": 0.0}
    )
    Training(longer, dataset, tmp_path / "a").run()
    with (tmp_path / "a" / "metrics.csv").open() as stream:
        losses = [float(row["diffusion"]) for row in csv.DictReader(stream)]
    assert losses[-1] < 0.6 * losses[0]


def test_nan_stops_with_the_batch(settings, dataset, tmp_path):
    training = Training(settings, dataset, tmp_path / "a")
    run = training.train_step

    def poisoned():
        if training.step == 4:
            with torch.no_grad():
                next(training.model.parameters()).fill_(torch.nan)
        return run()

    training.train_step = poisoned
    with pytest.raises(DivergedError, match="step 4"):
        training.run()
    batch = load_file(tmp_path / "a" / "diverged-step-4.safetensors")
    assert batch["values"].shape == (32, 8, 12, 2)
    assert not (tmp_path / "a" / "weights.safetensors").exists()


def test_a_full_disk_leaves_the_last_checkpoint(settings, dataset, tmp_path, monkeypatch):
    run_until(settings, dataset, tmp_path / "a", 5)
    before = (tmp_path / "a" / checkpoint.FILE).read_bytes()
    training = Training(settings, dataset, tmp_path / "a", resume=True)

    def full(descriptor):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(UserError, match=r"No space left on device.*--resume"):
        training.run()
    assert (tmp_path / "a" / checkpoint.FILE).read_bytes() == before
    assert not list((tmp_path / "a").glob(".*"))


def test_what_was_begun_otherwise_is_refused(settings, dataset, tmp_path):
    run_until(settings, dataset, tmp_path / "a", 2)
    with pytest.raises(UserError, match="--resume"):
        Training(settings, dataset, tmp_path / "a")
    other = settings.model_copy(update={"batch": 16})
    with pytest.raises(UserError, match=r"batch: 16 .* begun with 32"):
        Training(other, dataset, tmp_path / "a", resume=True)
    more = made_up_dataset(tmp_path / "more", {"one": grid_network(1, 1)}, episodes=1)
    with pytest.raises(UserError, match="another dataset"):
        Training(settings, more, tmp_path / "a", resume=True)
    with pytest.raises(UserError, match="no training was begun there"):
        Training(settings, dataset, tmp_path / "b", resume=True)
    path = tmp_path / "a" / checkpoint.FILE
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(UserError, match="cut off"):
        Training(settings, dataset, tmp_path / "a", resume=True)


def test_a_damaged_episode_is_found_before_anything_starts(settings, tmp_path):
    data = made_up_dataset(tmp_path / "d", {"one": grid_network(1, 2)}, episodes=3)
    last = sorted((data.path / "episodes").iterdir())[-1]
    content = last.read_bytes()
    for damage in (lambda: last.write_bytes(content[:-1]), last.unlink):
        damage()
        with pytest.raises(UserError, match=last.name):
            Training(settings, data, tmp_path / "a")
    assert not (tmp_path / "a").exists()


def test_learning_rate(settings):
    rates = [learning_rate(settings, step) for step in range(settings.steps + 1)]
    assert rates[0] < rates[1] < rates[2]
    assert rates[2] > rates[6] > rates[12] == settings.final_learning_rate


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("data = 'd'\nbach = 3", "at bach: there is no such setting; did you mean batch?"),
        ("data = 'd'\n[model]\nwidht = 64", "at model.widht: .* did you mean width?"),
        ("data = 'd'\nsteps = 0", "at steps"),
        ("steps = 3", "at data"),
        ("data = []", "at data"),
        ("data = ['d', 3]", "at data"),
        ("data = ", "not valid TOML"),
    ],
)
def test_bad_configs(tmp_path, text, words):
    path = tmp_path / "c.toml"
    path.write_text(text)
    with pytest.raises(UserError, match=words) as caught:
        read_training(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", bundled_trainings())
def test_the_bundled_trainings_are_valid(name):
    settings = read_training(name)
    if isinstance(settings, TrainingSettings):
        assert sum(settings.masks.shares) == pytest.approx(1)
    else:
        assert settings.algorithm == re.sub("-(any|first|second)$", "", name)


def test_a_config_that_is_not_there():
    with pytest.raises(UserError, match="cannot be read"):
        read_training("nothing")
