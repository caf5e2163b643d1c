"""``tsc-train`` and ``tsc-run`` with a baseline, as they are used."""

import csv
import json

import pytest

pytest.importorskip("torch", reason="the baselines need torch")

from tests.baselines.cases import queue_dataset
from tests.cli.refusals import refused
from tests.networks import grid_network

CONFIG = """
algorithm = "{algorithm}"
data = "data/small"
batch = 16
width = 8
log_steps = 4
"""


@pytest.fixture
def data(command):
    """A made-up dataset in the folder where commands run."""
    (command.cwd / "data").mkdir()
    return queue_dataset(command.cwd / "data" / "small", episodes=4)


def write(command, algorithm="cql", more=""):
    (command.cwd / "b.toml").write_text(CONFIG.format(algorithm=algorithm) + more)


def test_train_and_run(command, data, small_net):
    write(command)
    done = command("train", "b.toml", "--steps", 8)
    assert done.returncode == 0, done.stderr
    folder = "runs/train-b-small"
    assert done.stdout == f"{folder}/weights.safetensors\n"
    with (command.cwd / folder / "metrics.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [row["step"] for row in rows] == ["4", "8"]
    assert {"td_loss", "held_out_td_error", "held_out_accuracy"} <= rows[0].keys()

    run = ("--net", small_net, "--horizon", 150, "--missing", "kriging", "--rate", 0.3, "--json")
    options = ("--controller", "cql", "--imputer", "sfm", "--blind", "none")
    done = command("run", *run, *options, "--policy-weights", "runs/train-b-{net}")
    assert done.returncode == 0, done.stderr
    record = json.loads(done.stdout)
    assert record["result"]["fallbacks"] == 0
    assert record["result"]["imputation_mae"] > 0
    assert f"weights: {folder}" in record["checksums"]
    words = ["they are of cql, not of bc"]
    refused(command, "run", *run, "--controller", "bc", "--q-weights", folder, words=words)
    words = ["weights of kind baseline, not difflight"]
    refused(command, "run", *run, "--weights", folder, words=words)

    refused(command, "train", "b.toml", "--steps", 8, words=["--resume goes on"])
    queue_dataset(command.cwd / "other", networks={"one": grid_network(1, 1)}, episodes=2)
    other = ("--data", "other", "--steps", 8, "--out", folder, "--resume")
    refused(command, "train", "b.toml", *other, words=["other", "begun with another dataset"])


def test_a_bundled_config_by_its_name_with_other_data(command, data):
    done = command("train", "--algorithm", "bc", "--data", "data/small", "--steps", 2)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "runs/train-bc-small/weights.safetensors\n"


@pytest.mark.parametrize(
    ("algorithm", "more", "options", "words"),
    [
        ("cql", "alfa = 1", (), ["at alfa"]),
        ("bc", "alpha = 1", (), ["at alpha"]),
        ("cql", "alpha = -1", (), ["at alpha"]),
        ("cqll", "", (), ["at algorithm", "cqll", "did you mean cql?"]),
        ("td3-bc", "", ("--rounds", 3), ["--rounds: 3 is not allowed; the training b has no"]),
        ("cql", "", ("--data", "nowhere"), ["nowhere", "there is no such folder"]),
        ("cql", "held_out = 0", (), ["at held_out"]),
    ],
)
def test_bad_trainings(command, algorithm, more, options, words):
    write(command, algorithm, more)
    refused(command, "train", "b.toml", *options, words=words)
    assert not (command.cwd / "runs").exists()


def test_no_weights_for_this_network(command, small_net):
    words = ["td3-bc-small", "`tsc-train td3-bc --data data/small`", "--policy-weights"]
    refused(command, "run", "--net", small_net, "--controller", "td3-bc", words=words)
