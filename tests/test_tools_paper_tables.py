"""``python -m tools.paper_tables``: which suites, and a run that two of them share."""

import os
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tools import paper_tables
from tools.paper_tables import SUITES, arguments, batch_words
from tsc_missing.batch.suite import bundled_suites, read_suite

ROOT = Path(__file__).resolve().parents[1]
OURS = {
    "baselines",
    "benchmark",
    "datasets",
    "headline",
    "horizon",
    "newyork",
    "scoring",
    "smoke",
    "strict",
}  # the paper's numbers beside ours


def test_all_suites_of_the_paper():
    about = {name: read_suite(name).paper for name in bundled_suites()}
    assert {name for name, tables in about.items() if tables} - OURS <= set(SUITES)
    assert set(SUITES) <= set(about)


def test_later_suites_reuse_earlier_ones(tmp_path):
    for name in ("no-missing", "limits"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "batch.json").touch()
    wanted = arguments(["--runs", str(tmp_path), "--reuse", "elsewhere", "--set", "seed=[0]"])
    words = batch_words("random-missing", wanted)
    assert words[-4:] == ["--reuse", "elsewhere", "--reuse", str(tmp_path / "no-missing")]
    assert words[words.index("--set") + 1] == "seed=[0]"


def make_tables(cwd, changes, *suites):
    words = [word for change in changes for word in ("--set", change)]
    return subprocess.run(
        [sys.executable, "-m", "tools.paper_tables", *words, "--only", *suites],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
    )


def test_suites_in_which_nothing_can_run_are_left_out(tmp_path):
    done = make_tables(tmp_path, ["seed=0"], "generalisation")
    assert done.returncode == 0, done.stderr
    assert done.stdout.endswith("generalisation: left out, no method of it has weights here\n")
    assert list(tmp_path.iterdir()) == []
    done = make_tables(tmp_path, ["missing.rate=7"], "generalisation")
    assert done.returncode == 2
    assert "left out" not in done.stdout


@pytest.mark.parametrize(
    ("batch", "report", "reports"),
    [(0, 0, True), (0, 2, True), (1, 0, True), (2, 0, False), (130, 0, False)],
)
def test_a_suite_of_which_some_runs_failed_is_reported(monkeypatch, batch, report, reports):
    ran = []

    def run(name, words):
        ran.append(name)
        return {"batch": batch, "report": report}[name]

    monkeypatch.setattr(paper_tables, "run_command", run)
    monkeypatch.setattr(sys, "argv", ["paper_tables", "--only", "limits"])
    assert paper_tables.main() == (batch or report)
    assert ran == ["batch", *(["report"] if reports else [])]


def test_a_shared_run_is_made_once(tmp_path, small_net):
    methods = "method=['max-queue', 'advanced-max-pressure']"
    short = [f"net='{small_net}'", "horizon=45", "seed=[0]", methods]
    done = make_tables(tmp_path, short, "no-missing", "limits")
    assert done.returncode == 0, done.stderr
    runs = [tmp_path / "runs" / name for name in ("no-missing", "limits")]
    shared = [folder / "runs" / "small-none-max-queue-seed0" / "run.json" for folder in runs]
    assert shared[0].read_bytes() == shared[1].read_bytes()
    assert pq.read_table(runs[1] / "results.parquet").num_rows == 8
    assert all((folder / "report" / "report.html").is_file() for folder in runs)
