"""``python -m tools.resco``: which kept results are used again, and what the table says."""

import json
import shutil

import pytest

import tools.resco
from tools.resco import head, import_network, run_cells
from tools.runs import run_one
from tsc_missing.config import DiffusionSettings, MissingSettings, RunSettings

ROW = ("none", "difflight")


@pytest.fixture(scope="module")
def result(small_net):
    return run_one(RunSettings(net=str(small_net), controller="fixed-time", horizon=60))


@pytest.fixture
def ran(result, monkeypatch):
    """The settings of the runs that were asked for, each answered by ``result``."""
    asked = []

    def run_all(settings, workers):
        asked.extend(settings)
        return [result] * len(settings)

    monkeypatch.setattr(tools.resco, "run_all", run_all)
    return asked


@pytest.fixture
def weights(tmp_path):
    path = tmp_path / "weights"
    path.write_bytes(b"first")
    return path


@pytest.fixture
def settings(small_net, weights):
    return RunSettings(
        net=str(small_net),
        controller="difflight",
        horizon=60,
        diffusion=DiffusionSettings(weights=str(weights)),
    )


@pytest.fixture
def run(tmp_path, ran):
    """Run the one cell with these settings; returns how many runs that took."""
    keep = tmp_path / "keep"
    keep.mkdir()

    def once(settings):
        before = len(ran)
        found = run_cells([("small", ROW, settings)], keep, 2)
        assert found.keys() == {("small", *ROW)}
        return len(ran) - before

    once.keep = keep
    return once


def test_a_kept_result_is_read(run, settings, result, ran):
    assert run(settings) == 1
    assert run(settings) == 0
    assert run_cells([("small", ROW, settings)], run.keep, 1) == {("small", *ROW): result}
    assert len(ran) == 1


def test_other_settings_are_run(run, settings):
    run(settings)
    other = settings.model_copy(update={"missing": MissingSettings(pattern="random", rate=0.1)})
    assert run(other) == 1
    assert run(other) == 0


def test_other_weights_are_run_under_another_name_or_the_same(run, settings, weights, tmp_path):
    run(settings)
    weights.write_bytes(b"second")
    assert run(settings) == 1
    (tmp_path / "copy").write_bytes(b"third")
    diffusion = DiffusionSettings(weights=str(tmp_path / "copy"))
    assert run(settings.model_copy(update={"diffusion": diffusion})) == 1


def test_other_versions_are_run(run, settings, monkeypatch):
    run(settings)
    monkeypatch.setattr(tools.resco, "versions", lambda: {"libsumo": "0"})
    assert run(settings) == 1


def test_a_result_without_what_it_was_made_of_is_run_again(run, settings, result):
    run(settings)
    (kept,) = run.keep.iterdir()
    kept.write_text(json.dumps(result.model_dump(mode="json")))
    assert run(settings) == 1


def test_only_what_lacks_is_run(run, settings, ran):
    run(settings)
    cells = [("small", ROW, settings), ("small", ("none", "fixed-time"), settings)]
    assert len(run_cells(cells, run.keep, 2)) == 2
    assert len(ran) == 2


def test_a_kept_network_is_imported_again_by_other_versions(tmp_path, small_net, monkeypatch):
    made = []

    def import_sumo(wanted, folder, name):
        made.append(name)
        shutil.copytree(small_net, folder)

    monkeypatch.setattr(tools.resco, "import_sumo", import_sumo)
    for _ in range(2):
        assert import_network("small", tmp_path, tmp_path / "keep") == tmp_path / "keep" / "small"
    assert made == ["small"]
    monkeypatch.setattr(tools.resco, "builder_versions", lambda: {"libsumo": "0"})
    import_network("small", tmp_path, tmp_path / "keep")
    assert made == ["small"] * 2


def test_the_table_tells_the_command_that_made_it():
    text = "\n".join(head(["--networks", "cologne1", "--keep", "a folder"]))
    assert "`python -m tools.resco --networks cologne1 --keep 'a folder'`" in text
