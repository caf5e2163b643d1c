"""Batches whose folder changes, or breaks, at the wrong moment."""

import json
from pathlib import Path

import pytest

from tests.batch.cases import SUITE
from tsc_missing.batch import run as running
from tsc_missing.batch.folder import FAILURES, PLAN, RUNS, Failure, finished_runs
from tsc_missing.batch.run import Means, prepare_batch, run_batch
from tsc_missing.batch.suite import read_suite
from tsc_missing.batch.task import Task, run_task
from tsc_missing.batch.worker import Outcome
from tsc_missing.errors import UserError
from tsc_missing.versions import versions


@pytest.fixture
def prepare(tmp_path, small_net):
    """Prepares the same batch of two runs, or one of another horizon."""

    def prepared(horizon=30):
        text = SUITE.format(net=small_net, methods='"max-queue"', horizon=horizon, seeds="[0, 1]")
        path = tmp_path / f"small-{horizon}.toml"
        path.write_text(text)
        return prepare_batch(read_suite(str(path)), tmp_path / "b", skip=False, any_version=False)

    return prepared


def names(batch):
    return [run.name for run in batch.suite.runs]


def test_what_another_batch_made_meanwhile_is_looked_at_again(prepare):
    same, other = prepare(), prepare(horizon=45)
    run_batch(prepare(), Means())
    there = {name: (same.out / RUNS / name).stat().st_ino for name in names(same)}
    assert run_batch(same, Means()) == {}
    assert {name: (same.out / RUNS / name).stat().st_ino for name in there} == there
    with pytest.raises(UserError, match="other settings; horizon was 30, is 45"):
        run_batch(other, Means())
    assert len(list((same.out / RUNS).iterdir())) == 2


def test_a_table_that_cannot_be_made_costs_no_run(prepare, monkeypatch):
    def broken(out):
        raise UserError("--out", out, "the file cannot be read")

    monkeypatch.setattr(running, "write_table", broken)
    batch = prepare()
    with pytest.raises(UserError, match="cannot be read"):
        run_batch(batch, Means())
    assert finished_runs(batch.out, batch.suite.runs, batch.scenarios, False) == set(names(batch))


def test_a_start_without_space_leaves_nothing_and_one_that_was_killed_goes_on(prepare, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    batch = prepare()
    with monkeypatch.context() as patch:
        patch.setattr("tsc_missing.batch.folder.replace_file", full)
        with pytest.raises(UserError, match=r"cannot be written .*No space left"):
            run_batch(batch, Means())
    assert not batch.out.exists()
    for folder in (RUNS, FAILURES):
        (batch.out / folder).mkdir(parents=True)
    (batch.out / f".{PLAN}.123").touch()
    prepare()
    (batch.out / RUNS / "something").mkdir()
    with pytest.raises(UserError, match="something else is in it"):
        prepare()


def test_a_folder_that_is_no_run_is_none(prepare):
    batch = prepare()
    run_batch(batch, Means())
    (batch.out / RUNS / names(batch)[0] / "run.json").unlink()
    with pytest.raises(UserError, match=r"without a run\.json; .*remove it"):
        prepare()


def test_a_run_whose_process_ended_just_after_it_is_there(prepare):
    batch = prepare()
    run_batch(batch, Means())
    one, _ = names(batch)
    late = Outcome(one, Failure(kind="timeout", error="it took more than 2 s"), 2.0)
    assert running._keep(batch.out, late)
    assert not (batch.out / FAILURES / f"{one}.json").exists()
    lost = Outcome("nowhere", None, 2.0)
    assert not running._keep(batch.out, lost)
    said = json.loads((batch.out / FAILURES / "nowhere.json").read_text())
    assert "the folder is not there" in said["error"]


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (OSError(28, "No space left on device"), "cannot be written (No space left on device)"),
        (ConnectionResetError("the peer has gone"), "ConnectionResetError: the peer has gone"),
    ],
    ids=["full", "reset"],
)
def test_faults_that_pass_are_worth_another_attempt(prepare, tmp_path, monkeypatch, fault, words):
    def broken(*_):
        raise fault

    monkeypatch.setattr("tsc_missing.evaluation.run._execute", broken)
    (run, _) = prepare().suite.runs
    task = Task(run.name, run.settings, tmp_path / "x", False, tmp_path, versions(), Path.cwd())
    failure = run_task(task)
    assert failure.kind == "error"
    assert words in failure.error
    assert not task.folder.exists()


def test_a_worker_of_another_version_runs_nothing(prepare, tmp_path):
    (run, _) = prepare().suite.runs
    wanted = {**versions(), "source": "another"}
    task = Task(run.name, run.settings, tmp_path / "x", False, tmp_path, wanted, Path.cwd())
    failure = run_task(task)
    assert failure.kind == "refused"
    assert "'source': 'another'" in failure.error
    assert not task.folder.exists()
