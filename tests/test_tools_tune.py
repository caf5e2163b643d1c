"""``python -m tools.tune``: the same budget for each baseline, and what becomes of its results."""

from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("torch", reason="the baselines need torch")

import tools.tune
from tools.tune import CASES, config_text, read_tuning, score, suite_text, table, train
from tsc_missing.baselines.config import SETTINGS
from tsc_missing.baselines.registry import make_learner
from tsc_missing.baselines.weights import save_policy
from tsc_missing.batch.suite import read_suite
from tsc_missing.errors import UserError
from tsc_missing.training.config import read_training

TUNING, TRIES = read_tuning()


def test_every_baseline_has_the_same_number_of_tries():
    assert set(TUNING.methods) == set(SETTINGS)
    assert {len(method.tries) for method in TUNING.methods.values()} == {4}
    assert len({trial.folder for trial in TRIES}) == len(TRIES)


@pytest.mark.parametrize("algorithm", SETTINGS)
def test_what_is_bundled_was_tried(algorithm):
    bundled = read_training(algorithm)
    tried = [trial.options for trial in TRIES if trial.algorithm == algorithm]
    assert {key: getattr(bundled, key) for key in tried[0]} in tried


@pytest.mark.parametrize("trial", TRIES, ids=lambda trial: trial.label)
def test_a_try_is_the_bundled_training_but_for_its_options(trial, tmp_path):
    (tmp_path / "c.toml").write_text(config_text(trial))
    found = read_training(str(tmp_path / "c.toml"))
    bundled = read_training(trial.algorithm, data=found.data)
    assert found == bundled.model_copy(update=trial.options)


def test_all_tries_run_alike(tmp_path):
    (tmp_path / "s.toml").write_text(suite_text(TUNING, TRIES))
    runs = read_suite(str(tmp_path / "s.toml")).runs
    assert len(runs) == len(TRIES) * len(CASES) * len(TUNING.seeds)
    assert {run.case for run in runs} == set(CASES)
    assert {run.settings.demand for run in runs} == {"profile"}
    assert {(run.settings.imputer, run.settings.blind) for run in runs} == {("sfm", "none")}
    labels = {trial.label: str(trial.folder) for trial in TRIES}
    assert {run.method: run.settings.q_weights for run in runs} == labels


def test_the_best_has_the_least_mean(monkeypatch):
    tries = TRIES[:2]
    good = {"none": 310.0, "random 50 %": 320.0}
    bad = {"none": 300.0, "random 50 %": 340.0}
    assert score(good) < score(bad)
    manifest = {"held_out": {"accuracy": 0.5}}
    monkeypatch.setattr("tools.tune.read_tensors", lambda *_: (manifest, {}))
    lines = table(tries, {tries[0].label: bad, tries[1].label: good})
    assert "**" not in lines[2]
    assert f"**{tries[1].words}** | 50.0% | 310.0 | 320.0" in lines[3]


class TestWeightsThatAreThere:
    """``train`` with weights in the folder: as good as new, or refused."""

    @pytest.fixture
    def trial(self, tmp_path, monkeypatch):
        """A try with small weights in its folder, of a log whose checksum is "old"."""
        monkeypatch.setattr(tools.tune, "FOLDER", tmp_path)
        trial = next(t for t in TRIES if t.algorithm == "bc").model_copy(
            update={"data": str(tmp_path / "log")}
        )
        (tmp_path / "c.toml").write_text(config_text(trial))
        settings = read_training(str(tmp_path / "c.toml"))
        trial.folder.mkdir()
        about = {"data": {"checksum": "old"}}
        save_policy(
            make_learner(settings).policy, settings, trial.folder / "weights.safetensors", about
        )
        return trial

    @pytest.fixture
    def log(self, trial, monkeypatch):
        """The log of the try; its checksum can be set."""
        log = SimpleNamespace(checksum="old")
        Path(trial.data).mkdir()
        monkeypatch.setattr(tools.tune, "read_dataset", lambda path: log)
        return log

    def test_of_the_same_settings_and_logs_they_stay(self, trial, log):
        assert train(trial) == 0

    def test_of_logs_that_are_gone_they_stay(self, trial):
        assert train(trial) == 0

    def test_of_other_settings_they_are_refused(self, trial, log, monkeypatch):
        changed = config_text(trial).replace("steps = ", "steps = 1")
        monkeypatch.setattr(tools.tune, "config_text", lambda trial: changed)
        with pytest.raises(UserError, match=r"were made with .*steps .*, not .*; remove them"):
            train(trial)

    def test_of_other_logs_they_are_refused(self, trial, log):
        log.checksum = "new"
        with pytest.raises(UserError, match="were made of other logs than"):
            train(trial)
