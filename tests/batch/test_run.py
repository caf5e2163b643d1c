"""Batches whose folder changes, or breaks, at the wrong moment."""

import json
from dataclasses import replace
from functools import partial
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
from tsc_missing.evaluation.scenario import find_scenario
from tsc_missing.report.results import read_results
from tsc_missing.versions import versions

OWN = """
from tsc_missing.controllers.max_queue import MaxQueue


class Mine(MaxQueue):
    pass
"""


@pytest.fixture
def prepare(tmp_path, small_net):
    """Prepares the same batch of two runs, or one of another horizon."""

    def prepared(horizon=30):
        text = SUITE.format(net=small_net, methods='"max-queue"', horizon=horizon, seeds="[0, 1]")
        path = tmp_path / f"small-{horizon}.toml"
        path.write_text(text)
        return prepare_batch(read_suite(str(path)), tmp_path / "b", skip=False, any_version=False)

    return prepared


def first_task(batch, tmp_path):
    run = batch.suite.runs[0]
    inputs, here = batch.inputs.of(run), Path.cwd()
    return Task(run.name, run.settings, tmp_path / "x", False, tmp_path, versions(), inputs, here)


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
    assert finished_runs(batch.out, batch.suite.runs, batch.inputs, False) == set(names(batch))


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
    task = first_task(prepare(), tmp_path)
    failure = run_task(task)
    assert failure.kind == "error"
    assert words in failure.error
    assert not task.folder.exists()


def test_a_worker_of_another_version_runs_nothing(prepare, tmp_path):
    task = first_task(prepare(), tmp_path)
    failure = run_task(replace(task, versions={**versions(), "source": "another"}))
    assert failure.kind == "refused"
    assert "'source': 'another'" in failure.error
    assert not task.folder.exists()


def test_a_run_whose_inputs_changed_since_the_batch_began_is_refused(tmp_path, small_net):
    mine = tmp_path / "mine.py"
    mine.write_text(OWN)
    text = SUITE.format(net=small_net, methods=f'"{mine}:Mine"', horizon=30, seeds="[0, 1]")
    (tmp_path / "own.toml").write_text(text)
    suite = read_suite(str(tmp_path / "own.toml"))
    batch = prepare_batch(suite, tmp_path / "b", skip=False, any_version=False)
    task = first_task(batch, tmp_path)
    mine.write_text(f"{OWN}\n# edited\n")
    failure = run_task(task)
    assert failure.kind == "refused"
    assert f"code: {mine}:Mine changed since the batch began: was " in failure.error
    assert not task.folder.exists()


def test_runs_that_came_to_other_settings_are_not_taken(prepare, tmp_path):
    first = prepare()
    run_batch(first, Means())
    for name in names(first):
        path = first.out / RUNS / name / "run.json"
        record = json.loads(path.read_text())
        resolved = {**record["resolved"], "sampling_steps": [99, 99], "gone": 1}  # neither counts
        path.write_text(json.dumps({**record, "versions": {}, "resolved": resolved}))
    other = partial(prepare_batch, first.suite, skip=False, any_version=True)
    assert other(first.out).finished == set(names(first))
    reused = other(tmp_path / "c", reuse=[first.out])
    assert set(reused.reusable) == set(names(first))
    path.write_text(json.dumps({**record, "versions": {}, "resolved": {"min_space": 7}}))
    with pytest.raises(UserError, match="other resolved settings; min_space was 7, is 0"):
        other(first.out)
    assert set(other(tmp_path / "c", reuse=[first.out]).reusable) == set(names(first)[:1])


def test_lists_of_outages_may_be_named_by_another_path(tmp_path, small_net, monkeypatch):
    (tmp_path / "suite").mkdir()
    node = find_scenario(str(small_net), "auto").folder.network.ids[0]
    outages = tmp_path / "suite" / "dark.csv"
    outages.write_text(f"intersection,begin,end\n{node},0,60\n")
    text = SUITE.format(net=small_net, methods='"max-queue"', horizon=30, seeds="[0]")
    text = text.replace('{ pattern = "random", rate = 0.5 }', '{ file = "dark.csv" }')
    (tmp_path / "suite" / "small.toml").write_text(text)

    def prepared(suite, out="b", reuse=()):
        suite = read_suite(str(suite))
        return prepare_batch(suite, tmp_path / out, skip=False, any_version=False, reuse=reuse)

    run_batch(prepared(tmp_path / "suite" / "small.toml"), Means())
    monkeypatch.chdir(tmp_path)
    assert len(prepared("suite/small.toml").finished) == 1
    assert len(prepared("suite/small.toml", "c", [tmp_path / "b"]).reusable) == 1
    outages.write_text(f"intersection,begin,end\n{node},0,30\n")
    with pytest.raises(UserError, match=r"other checksums; mask: dark.csv was"):
        prepared("suite/small.toml")


def test_batches_of_versions_that_knew_other_settings(prepare, tmp_path):
    first = prepare()
    run_batch(first, Means())
    plan = json.loads((first.out / PLAN).read_text())
    for run in plan["suite"]["runs"]:
        run["settings"]["gone"] = 1
        path = first.out / RUNS / run["name"] / "run.json"
        record = json.loads(path.read_text())
        path.write_text(json.dumps({**record, "versions": {}, "settings": run["settings"]}))
    (first.out / PLAN).write_text(json.dumps(plan))
    reuse = partial(prepare_batch, first.suite, tmp_path / "c", skip=False, reuse=[first.out])
    assert set(reuse(any_version=True).reusable) == set(names(first))
    assert reuse(any_version=False).reusable == {}
    assert len(read_results([first.out]).finished) == 2

    (first.out / RUNS / "stray").mkdir()
    with pytest.raises(UserError, match=r"^--reuse: .* holds runs/stray without a run.json"):
        reuse(any_version=True)
    (first.out / RUNS / names(first)[0] / "run.json").unlink()
    with pytest.raises(UserError, match=r"^results: .* without a run.json"):
        read_results([first.out])
