"""``tsc-run`` as it is used: the real command line on real SUMO."""

import hashlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.cityflow_files import grid_flows, grid_roadnet, write

RUN_FILES = {"run.json", "decisions.parquet", "trips.parquet", "movements.parquet", "mask.npz"}
FULL = Path("/dev/full")


def run_json(command, *arguments):
    done = command("run", "--json", *arguments)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return json.loads(done.stdout)


def test_a_run_ends_with_a_table_and_a_whole_folder(command, small_net):
    done = command(
        "run", "--net", small_net, "--missing", "kriging", "--rate", 0.25, "--horizon", 300
    )
    assert done.returncode == 0, done.stderr
    for words in ("kriging", "att_all", "att_approach", "written to runs/"):
        assert words in done.stdout
    (folder,) = (command.cwd / "runs").iterdir()
    assert folder.name == "small-kriging-0.25-difflight-seed0"
    assert {file.name for file in folder.iterdir()} == RUN_FILES


def test_runs_of_one_name_at_the_same_time_keep_their_own_folders(command, small_net):
    options = ("--net", small_net, "--controller", "max-queue", "--horizon", 60)
    started = [command.start("run", *options, "--min-green", green) for green in (5, 10)]
    for process in started:
        _, errors = process.communicate(timeout=120)
        assert process.returncode == 0, errors
    names = ["small-none-max-queue-seed0", "small-none-max-queue-seed0-2"]
    found = [json.loads((command.cwd / "runs" / k / "run.json").read_text()) for k in names]
    assert {run["settings"]["signals"]["min_green"] for run in found} == {5, 10}
    assert sorted(p.name for p in (command.cwd / "runs").iterdir()) == names


def test_json_is_the_only_output_and_is_what_run_json_says(command, small_net):
    out = run_json(command, "--net", small_net, "--horizon", 300, "--out", "here")
    written = json.loads((command.cwd / "here" / "run.json").read_text())
    assert out.pop("out") == "here"
    assert out == written
    assert out["settings"]["horizon"] == 300
    assert out["result"]["missing_share"] == 0
    assert set(out["checksums"]) >= {"net.net.xml", "network.json", "routes.rou.xml"}
    assert out["versions"]["libsumo"]


def test_same_seed_same_bytes_other_seed_other_trips(command, small_net):
    options = ("--net", small_net, "--horizon", 450, "--missing", "random", "--rate", 0.5)
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        run_json(command, *options, "--seed", seed, "--out", name)
    read = {n: (command.cwd / n / "trips.parquet").read_bytes() for n in "abc"}
    assert read["a"] == read["b"] != read["c"]


@pytest.mark.parametrize("package", ["pandas", "rich"])
def test_what_a_run_does_not_need_is_not_loaded(command, small_net, tmp_path, monkeypatch, package):
    """A package of that name that cannot be loaded is put in front of the real one."""
    (tmp_path / f"{package}.py").write_text("raise RuntimeError('loaded')")
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    monkeypatch.setenv("PYTHONPATH", path.rstrip(os.pathsep))
    run_json(command, "--net", small_net, "--horizon", 60, "--out", "a")
    assert {file.name for file in (command.cwd / "a").iterdir()} == RUN_FILES


@pytest.mark.skipif(not FULL.exists(), reason="needs a device that is always full")
def test_output_that_cannot_be_written_is_an_error(command, small_net):
    arguments = ("--net", str(small_net), "--horizon", "30", "--json")
    with FULL.open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "tsc_missing.cli.run", *arguments],
            cwd=command.cwd,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=120,
        )
    assert done.returncode == 1
    assert done.stderr.startswith("error: OSError: [Errno 28] No space left on device")


def test_a_mask_can_be_replayed(command, small_net):
    options = ("--net", small_net, "--horizon", 300, "--controller", "max-queue")
    drawn = run_json(
        command, *options, "--missing", "mixed", "--rate", 0.4, "--mean-outage", 3, "--out", "a"
    )
    mask = command.cwd / "a" / "mask.npz"
    again = run_json(command, *options, "--mask", mask, "--out", "b", "--seed", 7)
    assert again["mask"] == "replayed"
    assert again["checksums"]["mask: mask.npz"] == hashlib.sha256(mask.read_bytes()).hexdigest()
    assert not any(name.startswith("mask") for name in drawn["checksums"])
    assert again["result"]["att_all"] == drawn["result"]["att_all"]
    assert (command.cwd / "b" / "mask.npz").read_bytes() == mask.read_bytes()
    unnamed = run_json(command, *options, "--mask", mask)
    assert unnamed["out"] == "runs/small-replayed-max-queue-seed0"


def test_decisions_hold_truth_estimates_and_what_was_observed(command, small_net):
    options = ("--missing", "random", "--rate", 0.5, "--blind", "none", "--horizon", 300)
    result = run_json(command, "--net", small_net, *options, "--out", "a")["result"]
    rows = pq.read_table(command.cwd / "a" / "decisions.parquet").to_pydict()
    assert len(rows["step"]) == 20 * 6
    observed = np.array(rows["observed"])
    truth, estimated = np.array(rows["vehicles"]), np.array(rows["estimated_vehicles"])
    np.testing.assert_array_equal(truth[observed], estimated[observed])
    error = np.abs(truth - estimated)[~observed].mean()
    assert result["imputation_mae"] == pytest.approx(error, rel=1e-6)
    assert result["missing_share"] == pytest.approx(1 - observed.mean())
    assert set(rows["phase"]) <= {0, 1, 2, 3}


@pytest.mark.parametrize(
    "controller",
    [
        "fixed-time",
        "fixed-time-15",
        "fixed-time-30",
        "max-queue",
        "max-pressure",
        "advanced-max-pressure",
        "rolling-horizon",
        "random",
        "actuated",
        "actuated-recall",
        "delay_based",
    ],
)
def test_every_controller_runs_without_an_accident(command, small_net, controller):
    result = run_json(command, "--net", small_net, "--controller", controller, "--horizon", 450)[
        "result"
    ]
    assert result["demand"] > 100
    assert result["finished"] > 0
    assert result["collisions"] == result["teleports"] == result["fallbacks"] == 0


@pytest.mark.parametrize("pattern", ["random", "kriging", "lane", "burst", "mixed"])
@pytest.mark.parametrize("imputer", ["sfm", "last", "mean"])
def test_every_pattern_and_imputer(command, small_net, pattern, imputer):
    options = ("--missing", pattern, "--rate", 0.3, "--imputer", imputer, "--blind", "none")
    result = run_json(command, "--net", small_net, *options, "--horizon", 150)["result"]
    assert 0 < result["missing_share"] < 0.8
    assert np.isfinite(result["imputation_mae"])
    assert result["fallbacks"] == 0


def test_broken_sensors_are_silent_for_the_whole_run(command, small_net):
    options = ("--net", small_net, "--missing", "lane", "--lasting", "--horizon", 150)
    out = run_json(command, *options, "--rate", 0.9, "--controller", "rolling-horizon")
    assert out["out"] == "runs/small-lane-lasting-0.9-rolling-horizon-seed0"
    assert out["result"]["missing_share"] == pytest.approx(65 / 72)
    assert out["result"]["fallbacks"] == 0
    mask = np.load(command.cwd / out["out"] / "mask.npz")["mask"]
    assert (mask == mask[:1]).all()
    assert not mask.any(axis=2).all()
    done = command("run", *options, "--rate", 0.25, "--controller", "max-queue")
    assert "max-queue, lane (lasting) missing at rate 0.25, seed 0" in done.stdout
    assert "warning" not in done.stdout


def test_area_detectors_as_long_as_the_lane_measure_the_lane(command, small_net):
    options = ("--net", small_net, "--horizon", 300, "--controller", "max-queue")
    lane = run_json(command, *options, "--out", "lane")
    area = run_json(
        command, *options, "--sensor", "area", "--detector-length", 1000, "--out", "area"
    )
    assert lane["result"]["att_all"] == area["result"]["att_all"]
    short = run_json(command, *options, "--sensor", "area", "--detector-length", 30)
    assert short["result"]["mean_queue"] < lane["result"]["mean_queue"]


def test_signal_options_change_the_signals(command, small_net):
    options = ("--net", small_net, "--horizon", 300, "--controller", "random")
    plain = run_json(command, *options)["result"]
    careful = run_json(command, *options, "--all-red", 3, "--min-green", 30)["result"]
    assert careful["held_greens"] > 0 == plain["held_greens"]
    assert careful["att_all"] != plain["att_all"]


def test_import_under_a_name_then_run_it(command, small_files):
    roadnet, flow = small_files
    named = ("--roadnet", roadnet, "--flow", flow, "--as", "town", "--horizon", 600)
    done = command("net", "import", *named)
    assert done.returncode == 0, done.stderr
    assert "6 intersections" in done.stdout
    result = run_json(command, "--net", "town", "--demand", "recorded", "--horizon", 150)
    assert result["scenario"] == "town"
    again = command("net", "import", *named)
    assert again.returncode == 2


def test_a_flow_for_a_bundled_dataset(command, tmp_path):
    files = write(tmp_path, grid_roadnet(3, 4), grid_flows(3, 4))
    named = ("--roadnet", files[0], "--flow", files[1], "--as", "jinan_1")
    done = command("net", "import", *named)
    assert done.returncode == 0, done.stderr
    result = run_json(command, "--net", "jinan", "--demand", "recorded", "--horizon", 45)
    assert (result["scenario"], result["demand"]) == ("jinan_1", "recorded")


@pytest.mark.parametrize("numbers", [[signal.SIGINT], [signal.SIGTERM, signal.SIGTERM]], ids=str)
def test_interrupting_leaves_no_run_folder(command, small_net, tmp_path, numbers):
    words = ("--net", small_net, "--horizon", 600000, "--out", "runs/one")
    process = command.start("run", *words, TMPDIR=str(tmp_path))
    deadline = time.monotonic() + 60
    while not list((command.cwd).glob("runs/.one.*")) and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(0.5)
    for number in numbers:
        process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert re.fullmatch(r"error: interrupted[^\n]*\n", errors)
    assert list(command.cwd.iterdir()) == []
    assert not list(tmp_path.glob("tsc-*"))


def test_programs_of_sumo_say_that_nothing_is_missing_for_them(command, small_net):
    words = ("--net", small_net, "--horizon", 60, "--controller", "actuated", "--no-decisions")
    done = command("run", *words, "--missing", "random", "--rate", "0.5")
    assert done.returncode == 0, done.stderr
    assert "warning: SUMO runs actuated itself, and it sees everything" in done.stdout
    assert "actuated, everything observed, seed 0" in done.stdout
    assert re.search(r"missing +0\.0 %", done.stdout)
    assert "warning" not in command("run", *words).stdout


def test_actuated_signals_whose_detectors_fail(command, small_net):
    words = ("--net", small_net, "--horizon", 450)
    for name in ("actuated", "actuated-recall"):
        run_json(command, *words, "--controller", name, "--out", name)
    options = ("--controller", "actuated-recall", "--missing", "kriging", "--rate", 0.3)
    done = command("run", *words, *options, "--blind", "fixed-time", "--out", "missing")
    assert "actuated-recall, kriging missing at rate 0.3, seed 0" in done.stdout
    (said,) = (line for line in done.stdout.splitlines() if "warning" in line)
    unused = "--blind fixed-time, which did nothing"
    assert said == f"warning: actuated-recall has no use for {unused}"
    files = {path.name: path / "trips.parquet" for path in command.cwd.iterdir()}
    trips = {name: path.read_bytes() for name, path in files.items()}
    assert trips["actuated"] == trips["actuated-recall"] != trips["missing"]
    result = json.loads((command.cwd / "missing" / "run.json").read_text())["result"]
    assert result["missing_share"] == pytest.approx(2 / 6)
    mask = np.load(command.cwd / "missing" / "mask.npz")["mask"]
    rows = pq.read_table(command.cwd / "missing" / "decisions.parquet").to_pydict()
    assert (np.array(rows["observed"]).reshape(mask.shape) == mask).all()


@pytest.mark.parametrize("controller", ["actuated", "actuated-recall"])
def test_actuated_signals_without_a_minimum_green(command, small_net, controller):
    words = ("--net", small_net, "--horizon", 300, "--controller", controller)
    missing = ("--missing", "lane", "--rate", 0.3)
    assert run_json(command, *words, *missing, "--min-green", 0)["result"]["finished"] > 0


@pytest.mark.parametrize(
    ("controller", "unused"),
    [
        ("fixed-time", ("--imputer", "last")),
        ("max-queue", ("--weights", "nowhere")),
        ("max-queue", ("--policy-weights", "nowhere")),
        ("max-queue", ("--scoring", "queue")),
        ("max-queue", ("--samples", "9")),
    ],
)
def test_an_option_that_does_nothing_is_said(command, small_net, controller, unused):
    words = ("--net", small_net, "--horizon", 60, "--missing", "random", "--rate", 0.5)
    done = command("run", *words, "--controller", controller, *unused)
    assert done.returncode == 0, done.stderr
    said = f"warning: {controller} has no use for {' '.join(unused)}, which did nothing"
    assert [said] == [line for line in done.stdout.splitlines() if "warning" in line]


def test_what_does_something_is_not_warned_of(command, small_net):
    words = ("--net", small_net, "--horizon", 60, "--missing", "random", "--rate", 0.5)
    diffusion = ("--imputer", "diffusion", "--sampling-steps", 1, "--weights", "universal")
    done = command("run", *words, "--controller", "max-queue", *diffusion)
    assert done.returncode == 0, done.stderr
    assert "warning" not in done.stdout


def test_a_scratch_folder_that_sumo_cannot_name(command, small_net, tmp_path):
    scratch = tmp_path / "a,b"
    scratch.mkdir()
    process = command.start("run", "--net", small_net, TMPDIR=str(scratch))
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 2
    assert re.fullmatch(r"error: path: [^\n]*a,b[^\n]*comma[^\n]*\n", errors)
