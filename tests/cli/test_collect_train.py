"""``tsc-collect`` and ``tsc-train`` as they are used."""

import json
import os
import shutil
import signal
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="the diffusion controller needs torch")

from tests.cli.refusals import refused
from tsc_missing.offline.dataset import read_dataset
from tsc_missing.offline.seen import saw_nothing

CONFIG = """
data = "data"
batch = 16
steps = {steps}
precision = "float32"
[model]
width = 16
hidden = 16
inverse_width = 16
"""


def collect(command, net, *options, episodes=2):
    volume = ("--demand", "recorded", "--volume-min", 1, "--volume-max", 1)
    common = ("--out", "data", "--net", net, "--horizon", 300, "--episodes", episodes)
    return command("collect", *common, *volume, *options)


def config(command, steps=4):
    (command.cwd / "c.toml").write_text(CONFIG.format(steps=steps))


def test_collect_go_on_train_resume(command, small_net):
    done = collect(command, small_net)
    assert done.returncode == 0, done.stderr
    assert "2 episodes complete" in done.stdout
    first = command.cwd / "data" / "episodes" / "00000.parquet"
    made = first.stat().st_mtime_ns, first.read_bytes()
    (command.cwd / "data" / "episodes" / ".00001.parquet.1").write_bytes(b"cut off")
    done = collect(command, small_net, "--workers", 1, episodes=3)
    assert done.returncode == 0, done.stderr
    assert (first.stat().st_mtime_ns, first.read_bytes()) == made
    data = read_dataset(command.cwd / "data")
    assert data.manifest.complete
    assert len(data.manifest.episodes) == 3
    assert len(list((command.cwd / "data" / "episodes").iterdir())) == 3
    assert data.manifest.statistics.max_vehicles >= data.manifest.statistics.mean_vehicles > 0
    assert data.load(0).phase.shape == (20, 6)
    other = collect(command, small_net, "--seed", 1)
    assert other.returncode == 2
    assert "begun with seed 0" in other.stderr

    config(command)
    (command.cwd / "file").touch()
    done = command("train", "c.toml", "--out", "file")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    done = command("train", "c.toml", "--out", "t")
    assert done.returncode == 0, done.stderr
    assert done.stdout == "t/weights.safetensors\n"
    again = command("train", "c.toml", "--out", "t")
    assert again.returncode == 2
    assert "--resume" in again.stderr
    both = command("train", "c.toml", "--out", "both", "--data", "data", "--data", "./data")
    assert (both.returncode, both.stderr.count("\n")) == (2, 1), both.stderr
    assert "named twice" in both.stderr
    shutil.copytree(command.cwd / "data", command.cwd / "own")
    both = command("train", "c.toml", "--out", "both", "--data", "data", "--data", "own")
    assert both.stdout == "both/weights.safetensors\n", both.stderr

    config(command, steps=1_000_000)
    process = command.start("train", "c.toml", "--out", "long")
    deadline = time.monotonic() + 60
    checkpoint = command.cwd / "long" / "checkpoint.safetensors"
    while not checkpoint.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors.startswith("interrupted; saved at step ")
    assert errors.count("\n") == 1


def test_an_interrupted_collection_says_so_in_one_line(command, small_net):
    words = ("--out", "data", "--net", small_net, "--demand", "recorded", "--horizon", 300)
    whole = ("--volume-min", 1, "--volume-max", 1, "--episodes", 500, "--workers", 2)
    process = command.start("collect", *words, *whole)
    deadline = time.monotonic() + 60
    while not list(command.cwd.glob("data/episodes/0*")) and time.monotonic() < deadline:
        time.sleep(0.05)
    for _ in range(2):  # as ``timeout`` does: to the process, and to its group
        process.send_signal(signal.SIGTERM)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors.startswith("interrupted with ")
    assert errors.count("\n") == 1, errors


def test_holes_and_their_blind_set(command, small_net):
    done = collect(command, small_net, "--missing", "kriging", "--rate", 0.3)
    assert done.returncode == 0, done.stderr
    data = read_dataset(command.cwd / "data")
    assert not data.manifest.complete
    logs = [data.load(number) for number in range(2)]
    assert all(not log.values[~log.recorded].any() for log in logs)
    blind = [~log.recorded.any(axis=(0, 2)) for log in logs]
    np.testing.assert_array_equal(*blind)
    assert blind[0].sum() == 2
    assert json.loads((command.cwd / "data" / "plan.json").read_text())["missing"]["rate"] == 0.3


def test_policies_may_lose_sensors_and_the_log_has_the_truth(command):
    done = command(
        *("collect", "--out", "data", "--net", "jinan", "--episodes", 2, "--horizon", 150),
        *("--policy", "difflight", "--lost", "kriging", "--lost", "none", "--min-space", 9),
        *("--unaware", 0, "--epsilon-max", 0),
    )
    assert done.returncode == 0, done.stderr
    data = read_dataset(command.cwd / "data")
    assert data.manifest.complete
    specs = [episode.spec for episode in data.manifest.episodes]
    assert [spec.lost for spec in specs] == ["kriging", "none"]
    blind = [saw_nothing(spec, data.networks["jinan"]) for spec in specs]
    assert blind[0].any()
    assert not blind[1].any()
    values = data.load(0).values[-1, :, :, 0]
    assert values[blind[0]].any()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--lost", "krigin"), "--lost: krigin is not allowed; did you mean kriging?"),
        (("--min-space", "-1"), "--min-space: -1"),
        (("--policy", "max-quue"), "did you mean max-queue"),
        (("--volume-min", "2", "--net", "jinan"), "volume_min"),
        (("--net", "jnan"), "did you mean"),
        (("--missing", "random", "--rate", "2"), "rate"),
        (("--missing", "burst", "--rate", "0.5", "--mean-outage", "0"), "--mean-outage: 0"),
        (("--missing", "random"), "--missing random needs a rate from 0 to 1"),
        (("--missing", "random", "--rate", "1"), "--rate: 1.0 is not allowed"),
        (("--missing", "lane", "--rate", "0"), "--rate: 0.0 is not allowed"),
    ],
)
def test_bad_collections(command, options, words):
    done = command("collect", "--out", "data", *options)
    assert done.returncode == 2
    assert words in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (command.cwd / "data").exists()


def test_training_without_data(command):
    config(command)
    done = command("train", "c.toml")
    assert done.returncode == 2
    assert done.stderr.startswith("error: data: data is not allowed; there is no such folder")
    assert list(command.cwd.iterdir()) == [command.cwd / "c.toml"]


Q_CONFIG = """
algorithm = "{algorithm}"
nets = ["{net}"]
demand = "recorded"
volume_min = 1
volume_max = 1
horizon = 150
rounds = 2
episodes = 1
updates = 3
batch = 12
width = 8
"""


def learn(command, small_net, algorithm):
    (command.cwd / "q.toml").write_text(Q_CONFIG.format(algorithm=algorithm, net=small_net))
    done = command("train", "q.toml", "--workers", 1)
    assert done.returncode == 0, done.stderr
    weights = command.cwd / "runs" / "train-q" / "weights.safetensors"
    assert done.stdout.split() == [str(weights.relative_to(command.cwd))]
    return weights


@pytest.mark.parametrize("algorithm", ["attendlight", "efficient-colight"])
def test_learn_and_run(command, small_net, algorithm):
    weights = learn(command, small_net, algorithm)
    run = ("--net", small_net, "--horizon", 150, "--missing", "random", "--rate", 0.3, "--json")
    done = command("run", *run, "--controller", algorithm, "--q-weights", weights)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)["result"]
    assert result["fallbacks"] == 0
    assert result["imputation_mae"] > 0


def test_what_learned_weights_are_refused_for(command, small_net):
    weights = learn(command, small_net, "value")
    refused(command, "train", "q.toml", words=["--resume goes on"])
    refused(command, "train", "q.toml", "--resume", "--seed", 1, words=["begun with 0"])
    run = ("run", "--net", small_net, "--controller")
    other = ("advanced-colight", "--q-weights", weights)
    refused(command, *run, *other, words=["they are of value, not of advanced-colight"])
    other = ("difflight", "--weights", weights)
    refused(command, *run, *other, words=["weights of kind q-network, not difflight"])


LOOKAHEAD = """
algorithm = "lookahead"
nets = ["{net}"]
demand = "recorded"
horizon = 300
episodes = {episodes}
updates = 3
batch = 12
"""


@pytest.mark.parametrize("config", [Q_CONFIG, LOOKAHEAD])
def test_trainings_into_a_file(command, small_net, config):
    values = {"net": small_net, "algorithm": "value", "episodes": 2}
    (command.cwd / "c.toml").write_text(config.format(**values))
    (command.cwd / "file").touch()
    for out in ("file", "file/below"):
        refused(command, "train", "c.toml", "--out", out, words=[f"out: {out} is not allowed"])
    new = ("c.toml", "--resume", "--out", "new")
    refused(command, "train", *new, words=["--resume: new is not allowed; no training was begun"])


def test_a_training_interrupted_twice_tells_of_what_it_saved(command, small_net):
    text = Q_CONFIG.format(algorithm="value", net=small_net)
    (command.cwd / "q.toml").write_text(text.replace("updates = 3", "updates = 1000000"))
    process = command.start("train", "q.toml", "--workers", 1)
    folder = command.cwd / "runs" / "train-q"
    deadline = time.monotonic() + 60
    while not list(folder.glob("episodes/00001-*")) and time.monotonic() < deadline:
        time.sleep(0.05)
    for _ in range(2):
        process.send_signal(signal.SIGINT)
        time.sleep(0.5)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors == (
        "error: interrupted; what was saved before, if anything, stays; --resume goes on\n"
    )
    assert list(folder.glob("*.safetensors"))


def children(pid):
    listed = Path(f"/proc/{pid}/task/{pid}/children")
    return [int(k) for k in listed.read_text().split()] if listed.exists() else []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_look_ahead_interrupted_and_gone_on_with(command, small_net, number):
    plan = command.cwd / "look.toml"
    plan.write_text(LOOKAHEAD.format(net=small_net, episodes=200))
    process = command.start("train", "look.toml", "--workers", 1)
    deadline = time.monotonic() + 60
    episodes = command.cwd / "runs" / "train-look" / "episodes"
    while not list(episodes.glob("0*")) and time.monotonic() < deadline:
        time.sleep(0.05)
    for pid in (*children(process.pid), process.pid):  # as to a group of processes
        os.kill(pid, number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors.startswith("interrupted; saved at episode "), errors
    assert errors.count("\n") == 1
    there = len(list(episodes.iterdir()))
    plan.write_text(LOOKAHEAD.format(net=small_net, episodes=there))  # enough of it
    done = command("train", "look.toml", "--resume")
    assert done.returncode == 0, done.stderr
    weights = command.cwd / done.stdout.strip()
    run = ("--net", small_net, "--horizon", 150, "--q-weights", weights, "--json")
    found = command("run", *run)
    assert found.returncode == 0, found.stderr
    assert json.loads(found.stdout)["result"]["fallbacks"] == 0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "config"),
        (("lookahead", "--steps", 3), "--steps: 3 is not allowed; the training lookahead has no"),
        (("universal", "--workers", 3), "--workers: 3 is not allowed; the training universal"),
        (("bc", "--steps", 0), "--steps: 0 is not allowed; Input should be greater"),
        (("--algorithm", "advanced-colite"), "did you mean advanced-colight?"),
        (("universal", "--algorithm", "value"), "give one of them"),
        (("value", "--steps", 3), "--steps: 3"),
        (("bc", "--data", "a", "--data", "b"), "--data: a and b is not allowed; the training bc"),
        (("value", "--data", "nothing"), "nothing"),
    ],
)
def test_bad_trainings(command, options, words):
    done = command("train", *options)
    assert done.returncode == 2, done.stderr
    assert words in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (command.cwd / "runs").exists()
