"""A list of outages on the command line: a run, a picture, a suite."""

import json
import re

import numpy as np
import pytest

from tests.cli.refusals import check_refusal
from tsc_missing.network.folder import read_folder
from tsc_missing.report.loss_map import find_losses
from tsc_missing.report.results import read_results
from tsc_missing.sensing.masks import load_mask

HORIZON = 300  # [s], 20 steps


@pytest.fixture
def listed(command, small_net):
    """A list: one intersection for the whole run, an approach of another for a while."""
    first, second = read_folder(small_net, "small").network.ids[:2]
    path = command.cwd / "centre.csv"
    path.write_text(f"intersection,slot,begin,end\n{first}\n{second},N,60,120\n")
    return path


def test_a_run_loses_what_the_list_says(command, small_net, listed):
    options = ("--net", small_net, "--controller", "max-queue", "--horizon", HORIZON)
    done = command("run", *options, "--mask", listed.name, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["out"] == "runs/small-centre-max-queue-seed0"
    assert found["mask"] == "listed"
    assert found["settings"]["missing"]["pattern"] == "file"
    assert "mask: centre.csv" in found["checksums"]
    network = read_folder(small_net, "small").network
    mask = load_mask(command.cwd / found["out"] / "mask.npz", network)
    lost = ~mask & network.slot_mask
    assert lost[:, 0][:, network.slot_mask[0]].all()
    north = network.slot_mask[1] & (np.arange(12) < 3)
    assert (lost[:, 1] == (north & ((np.arange(20) >= 4) & (np.arange(20) < 8))[:, None])).all()
    assert not lost[:, 2:].any()
    share = lost.sum() / (20 * network.slot_mask.sum())
    assert found["result"]["missing_share"] == pytest.approx(share)
    replayed = ("--mask", f"{found['out']}/mask.npz", "--out", "again", "--json")
    again = json.loads(command("run", *options, *replayed).stdout)
    assert again["result"]["att_all"] == found["result"]["att_all"]


def test_the_picture_says_what_the_list_loses(command, small_net, listed):
    done = command("net", "show", small_net, "--mask", listed.name, "--out", "a.svg", "--json")
    assert done.returncode == 0, done.stderr
    sensors = json.loads(done.stdout)["sensors"]
    assert sensors["source"] == "outages of centre.csv"
    assert len(sensors["never_observed"]) == 1
    assert sensors["partly_observed"] == 1
    assert shown(command, small_net, listed, "--horizon", 60)["partly_observed"] == 0
    assert shown(command, small_net, listed, "--decision-interval", 150)["partly_observed"] == 0


def shown(command, *arguments):
    done = command("net", "show", arguments[0], "--mask", *arguments[1:], "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)["sensors"]


def test_lists_are_an_axis_of_a_suite(command, small_net, listed):
    (command.cwd / "late.csv").write_text(listed.read_text().replace("60,120", "120,"))
    (command.cwd / "lists.toml").write_text(
        f'[[runs]]\nmethod = "max-queue"\nnet = "{small_net}"\nhorizon = {HORIZON}\n'
        'missing.file = ["centre.csv", "late.csv"]\n'
        f'[[runs]]\nmethod = "max-queue"\nnet = "{small_net}"\nhorizon = {HORIZON}\n'
    )
    batch = ("lists.toml", "--out", "b", "--workers", 1, "--json")
    done = command("batch", *batch)
    assert done.returncode == 0, done.stderr
    names = {path.name for path in (command.cwd / "b" / "runs").iterdir()}
    cases = ("none", "centre", "late")
    assert names == {f"small-{case}-max-queue-seed0" for case in cases}
    done = command("report", "b", "--out", "r")
    assert done.returncode == 0, done.stderr
    report = (command.cwd / "r" / "report.md").read_text()
    assert all(f" {case} |" in report for case in cases)
    listed.write_text(listed.read_text().replace("60", "45"))
    words = ["mask: centre.csv", "give another --out"]
    check_refusal(command, "batch", *batch, words=words)
    listed.write_text("intersection\nnowhere\n")
    words = ["missing.file: ", "line 2", "nowhere", "in the run small-"]
    check_refusal(command, "batch", "lists.toml", "--out", "c", words=words)
    assert not (command.cwd / "c").exists()


def test_which_sensors_are_missed_most(command, small_net):
    wanted = ("--out", "s", "--seeds", 1, "--method", "max-queue")
    done = command("net", "outages", small_net, *wanted)
    assert done.returncode == 0, done.stderr
    assert "6 lists of outages; the suite has 7 runs" in done.stdout
    assert "horizon = 600\n" in (command.cwd / "s" / "suite.toml").read_text()  # of its demand
    (command.cwd / "s").rename(command.cwd / "moved")
    batch = ("moved/suite.toml", "--out", "s/runs", "--set", f"horizon={HORIZON}", "--workers", 1)
    done = command("batch", *batch)
    assert done.returncode == 0, done.stderr
    runs = command.cwd / "s" / "runs"
    losses = find_losses(read_results([runs]), "small", "max-queue", "att_all")
    ids, costs = losses.folder.network.ids, losses.costs
    assert losses.cases == ids

    def att(case):
        run = json.loads((runs / "runs" / f"small-{case}-max-queue-seed0" / "run.json").read_text())
        return run["result"]["att_all"]

    assert costs == pytest.approx([att(name) / att("none") - 1 for name in ids])
    assert len({*costs}) > 1
    done = command("report", "s/runs", "--out", "r")
    assert done.returncode == 0, done.stderr
    assert (command.cwd / "r" / "figures" / "losses-small-max-queue.png").stat().st_size > 0
    report = (command.cwd / "r" / "report.md").read_text()
    losses = report.partition("## What each loss costs")[2].partition("\n## ")[0]
    shown = re.findall(r"^\| (\S+) \| ([+−][\d.]+) % \|$", losses, re.MULTILINE)
    order = np.argsort(-costs, kind="stable")
    assert [name.replace("\\", "") for name, _ in shown] == [ids[n] for n in order]
    assert shown[0][1] == f"+{100 * costs.max():.1f}"
    check_refusal(command, "net", "outages", small_net, *wanted, words=["--out: s ", "not exist"])


def test_approaches_go_silent_one_by_one(command, small_net):
    network = read_folder(small_net, "small").network
    wanted = ("--out", "s", "--each", "approach")
    done = command("net", "outages", small_net, *wanted)
    assert done.returncode == 0, done.stderr
    count = int(network.slot_mask.reshape(network.n, 4, 3).any(axis=2).sum())
    lists = sorted((command.cwd / "s").glob("*.csv"))
    assert len(lists) == count
    assert lists[0].read_text() == f"intersection,slot\n{network.ids[0]},E\n"
    done = command("batch", "s/suite.toml", "--list")
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("to run") == 3 * (count + 1)


@pytest.mark.parametrize("method", ["fixed-time", "actuated"])
def test_no_suite_for_what_reads_no_sensor(command, small_net, method):
    options = ("net", "outages", small_net, "--out", "sensors", "--method", method)
    check_refusal(command, *options, words=[f"--method: {method} is not allowed", "no sensor"])


def test_no_suite_for_a_method_that_is_not_there(command, small_net):
    options = ("net", "outages", small_net, "--out", "sensors", "--method", "max-queu")
    words = ["--method: max-queu is not allowed", "did you mean max-queue?"]
    check_refusal(command, *options, words=words)
    assert not (command.cwd / "sensors").exists()
    for method in ("DiffLight", "max-queue, diffusion", "advanced-colight", "actuated-recall"):
        options = ("net", "outages", small_net, "--out", method, "--method", method)
        assert command(*options).returncode == 0
    assert not (command.cwd / "sensors").exists()
