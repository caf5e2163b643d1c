"""``python -m tools.strict``: its two commands, and both of them run on a small network."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="the diffusion controller needs torch")

from tools.strict import METHODS, RATES, arguments, commands
from tsc_missing.diffusion.config import DiffLightConfig
from tsc_missing.diffusion.weights import load_weights
from tsc_missing.paths import bundled
from tsc_missing.training.config import read_training

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.parametrize("pattern", RATES)
@pytest.mark.parametrize("method", METHODS)
def test_each_config_begins_with_the_commands(method, pattern, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where nothing was begun that would be resumed
    text = (bundled("scenarios") / "training" / f"{method}-{pattern}.toml").read_text()
    head = "\n".join(line.removeprefix("#") for line in text.splitlines() if line.startswith("#"))
    told = [shlex.split(line) for line in head.replace("\\\n", " ").splitlines()]
    wanted = commands(arguments(["jinan_1", pattern, "--method", method]))
    for name, words in zip(("tsc-collect", "tsc-train"), wanted, strict=True):
        assert [name, *words] in told
    settings = read_training(f"{method}-{pattern}")
    published = DiffLightConfig.as_published()
    assert settings.model == (published if method == "paper" else DiffLightConfig())


def test_both_steps_and_again(tmp_path, small_net):
    given = [
        *(
            str(small_net),
            "random",
            "--seed",
            "1",
            "--policy",
            "max-queue",
            "--policy",
            "fixed-time",
        ),
        *("--episodes", "2", "--horizon", "150", "--steps", "2"),
    ]

    def run():
        return subprocess.run(
            [sys.executable, "-m", "tools.strict", *given],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            timeout=300,
        )

    done = run()
    assert done.returncode == 0, done.stderr
    weights = tmp_path / "runs" / "train-strict-small-random-seed1" / "weights.safetensors"
    _, manifest = load_weights(weights)
    assert not manifest["data"]["complete"]
    assert manifest["data"]["settings"]["missing"] == {
        **manifest["data"]["settings"]["missing"],
        "pattern": "random",
        "rate": 0.5,
    }
    assert manifest["data"]["settings"]["unaware"] == 0
    made = weights.stat().st_mtime_ns
    again = run()
    assert again.returncode == 0, again.stderr
    assert again.stdout.endswith("the weights are there\n")
    assert weights.stat().st_mtime_ns == made
