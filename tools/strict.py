"""Strict weights from nothing: the log with holes of a dataset's recorded flow, and a training.

    python -m tools.strict jinan_1 random
    python -m tools.strict hangzhou_1 kriging --method paper --seed 1

Runs `tsc-collect` and `tsc-train`, each in a process of its own, and prints them first. What is
there is not made again; stopped at any moment, the same command goes on. The recorded flow must
have been imported under the dataset's name (`tsc-net import`).
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tools.runs import run_command
from tsc_missing.offline.policies import RULES
from tsc_missing.training.checkpoint import FILE as CHECKPOINT
from tsc_missing.weights.find import FILE as WEIGHTS

RATES = {"random": 0.5, "kriging": 0.25}  # of the log; the weights are used at all rates
ONLINE = ("attendlight", "efficient-colight", "advanced-colight")
METHODS = ("strict", "paper")


def commands(wanted: argparse.Namespace) -> tuple[list[str], list[str]]:
    """The arguments of ``tsc-collect`` and of ``tsc-train``."""
    of = f"{Path(wanted.net).name}-{wanted.pattern}"
    if wanted.seed:
        of += f"-seed{wanted.seed}"
    data, out = Path("data", f"strict-{of}"), Path("runs", f"train-{wanted.method}-{of}")
    policies = [word for name in wanted.policy for word in ("--policy", name)]
    collect = (
        f"--out {data} --net {wanted.net} --demand recorded --volume-min 1 --volume-max 1 "
        f"--missing {wanted.pattern} --rate {RATES[wanted.pattern]} --unaware 0"
    )
    train = f"{wanted.method}-{wanted.pattern} --data {data} --out {out} --seed {wanted.seed}"
    resume = ["--resume"] if (out / CHECKPOINT).exists() else []
    steps = ["--steps", str(wanted.steps)] if wanted.steps else []
    horizon = ["--horizon", str(wanted.horizon)] if wanted.horizon else []
    size = ["--episodes", str(wanted.episodes), "--seed", str(wanted.seed)]
    return [*collect.split(), *policies, *size, *horizon], [*train.split(), *steps, *resume]


def arguments(given: Sequence[str] | None = None) -> argparse.Namespace:
    """What is wanted."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("net", help="a dataset that was imported: jinan_1, newyork_1, …")
    parser.add_argument("pattern", choices=RATES)
    parser.add_argument("--method", choices=METHODS, default="strict")
    parser.add_argument("--seed", type=int, default=0, help="of log, mask and training")
    parser.add_argument("--policy", action="append", help="instead of the usual; repeatable")
    parser.add_argument("--episodes", type=int, default=30)
    parser.add_argument("--horizon", type=int, help="simulated seconds of an episode")
    parser.add_argument("--steps", type=int, help="of the training, instead of the config's")
    parser.add_argument("--workers", type=int, default=1, help="simulations at a time")
    wanted = parser.parse_args(given)
    wanted.policy = wanted.policy or [*ONLINE, *RULES]
    return wanted


def main() -> int:
    """Collect, then train; the exit status of what failed, if anything."""
    wanted = arguments()
    collect, train = commands(wanted)
    for name, words in (
        ("collect", [*collect, "--workers", str(wanted.workers)]),
        ("train", train),
    ):
        if name == "train" and Path(train[train.index("--out") + 1], WEIGHTS).exists():
            print("the weights are there")
            break
        if status := run_command(name, words):
            return status
    return 0


if __name__ == "__main__":
    sys.exit(main())
