"""The tuning of the baselines: the same number of settings for each, judged by the same runs.

    python -m tools.tune --out docs/results/tuning.md
    python -m tools.tune --only cql td3-bc

Trains every setting of ``scenarios/tuning.toml`` (``tsc-train``), runs each behind
store-and-forward as the paper does (``tsc-batch``), and writes a table. What is there is not made
again; stopped at any moment, the same command goes on.
"""

import argparse
import json
import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path
from statistics import mean

import pyarrow.parquet as pq
from pydantic import BaseModel, ConfigDict

from tools.runs import run_command
from tsc_missing.baselines.config import SETTINGS
from tsc_missing.baselines.weights import KIND, load_policy
from tsc_missing.errors import UserError
from tsc_missing.offline.dataset import read_dataset
from tsc_missing.paths import bundled
from tsc_missing.training.checkpoint import FILE as CHECKPOINT
from tsc_missing.training.config import RESUMABLE
from tsc_missing.versions import versions
from tsc_missing.weights.file import read_tensors
from tsc_missing.weights.find import FILE as WEIGHTS

FOLDER = Path("runs/tune")
REFUSED = 2  # the exit status
CASES = ("none", "random 50 %")  # blind intersections break them all, so these would be noise


class Method(BaseModel):
    """What one baseline tries."""

    model_config = ConfigDict(extra="forbid")

    data: str  # the logs
    tries: list[dict[str, float | int]]  # options, in place of the bundled config's


class Tuning(BaseModel):
    """``scenarios/tuning.toml``."""

    model_config = ConfigDict(extra="forbid")

    net: str
    seeds: list[int]
    methods: dict[str, Method]


class Try(BaseModel):
    """One setting of one baseline."""

    algorithm: str
    data: str
    options: dict[str, float | int]

    @property
    def words(self) -> str:
        """The options, for a table."""
        return ", ".join(f"{key} {value:g}" for key, value in self.options.items())

    @property
    def label(self) -> str:
        """What its runs are called."""
        return f"{self.algorithm} {self.words}"

    @property
    def folder(self) -> Path:
        """Of its training."""
        parts = [f"{key}-{value:g}" for key, value in self.options.items()]
        return FOLDER / "-".join(["train", self.algorithm, *parts])


def read_tuning(only: Iterable[str] = ()) -> tuple[Tuning, list[Try]]:
    """The file, and the settings that it has for the methods ``only`` (all)."""
    text = (bundled("scenarios") / "tuning.toml").read_text(encoding="utf-8")
    tuning = Tuning.model_validate(tomllib.loads(text))
    wanted = list(only) or list(tuning.methods)
    return tuning, [
        Try(algorithm=name, data=tuning.methods[name].data, options=options)
        for name in wanted
        for options in tuning.methods[name].tries
    ]


def config_text(trial: Try) -> str:
    """The training as TOML: the bundled config with the options put in."""
    path = bundled("scenarios") / "training" / f"{trial.algorithm}.toml"
    values = {**tomllib.loads(path.read_text(encoding="utf-8")), **trial.options}
    values["data"] = trial.data
    SETTINGS[trial.algorithm].model_validate(values)
    return "".join(f"{key} = {json.dumps(value)}\n" for key, value in values.items())


def check_made(trial: Try) -> None:
    """Raise ``UserError`` if the weights that are there came of other settings or another log."""
    path = trial.folder / WEIGHTS
    _, made, manifest = load_policy(path)
    wanted = SETTINGS[trial.algorithm].model_validate(tomllib.loads(config_text(trial)))
    allowed = "remove them, and they are made again"
    for name in sorted(type(wanted).model_fields.keys() - RESUMABLE):
        was, now = getattr(made, name, None), getattr(wanted, name)
        if was != now:
            raise UserError("weights", path, allowed, f"were made with {name} {was}, not {now}")
    log = Path(trial.data)
    if log.is_dir() and read_dataset(log).checksum != manifest["data"]["checksum"]:
        raise UserError("weights", path, allowed, f"were made of other logs than {log} has now")


def train(trial: Try) -> int:
    """Train one setting, unless it is there; the exit status.

    Raises ``UserError`` where what is there is not what this would make.
    """
    out = trial.folder
    if (out / WEIGHTS).is_file():
        check_made(trial)
        return 0
    config = FOLDER / f"{out.name}.toml"
    config.write_text(config_text(trial), encoding="utf-8")
    resume = ["--resume"] if (out / CHECKPOINT).exists() else []
    return run_command("train", [str(config), "--out", str(out), *resume])


def suite_text(tuning: Tuning, tries: Iterable[Try]) -> str:
    """The runs of all settings as a suite: behind store-and-forward everywhere, as in the paper."""
    tries = list(tries)
    methods = "".join(
        f'[methods."{trial.label}"]\ncontroller = "{trial.algorithm}"\nimputer = "sfm"\n'
        f'blind = "none"\nq_weights = "{trial.folder}"\n\n'
        for trial in tries
    )
    return (
        f'title = "Tuning"\n\n{methods}[[runs]]\nmethod = {json.dumps([t.label for t in tries])}\n'
        f'net = "{tuning.net}"\ndemand = "profile"\nseed = {tuning.seeds}\nmissing = [\n'
        '    { pattern = "none" },\n    { pattern = "random", rate = 0.5 },\n]\n'
    )


def results(tries: Iterable[Try]) -> dict[str, dict[str, float]]:
    """``att_all`` [s] by setting and case, means over the seeds."""
    rows = pq.read_table(FOLDER / "batch" / "results.parquet").to_pylist()
    return {
        trial.label: {
            case: mean(
                row["att_all"]
                for row in rows
                if row["method"] == trial.label and row["case"] == case
            )
            for case in CASES
        }
        for trial in tries
    }


def table(tries: Iterable[Try], found: dict[str, dict[str, float]]) -> list[str]:
    """Markdown: a row a setting, the best of each method in bold."""
    lines = [
        f"| | | held-out accuracy | {' | '.join(CASES)} |",
        f"| --- | --- | ---: |{' ---: |' * len(CASES)}",
    ]
    tries = list(tries)
    for trial in tries:
        rivals = [found[other.label] for other in tries if other.algorithm == trial.algorithm]
        mine = found[trial.label]
        best = score(mine) == min(map(score, rivals))
        words = f"**{trial.words}**" if best else trial.words
        manifest, _ = read_tensors(trial.folder / WEIGHTS, KIND)
        accuracy = manifest["held_out"]["accuracy"]
        cells = [f"{mine[case]:.1f}" for case in CASES]
        lines.append(f"| {trial.algorithm} | {words} | {accuracy:.1%} | {' | '.join(cells)} |")
    return lines


def score(of: dict[str, float]) -> float:
    """What decides, the least is best: the mean over the cases."""
    return mean(of[case] for case in CASES)


def report(tuning: Tuning, tries: Iterable[Try]) -> str:
    """The page: what was run, and the table."""
    tries = list(tries)
    about = ", ".join(f"{name} {number}" for name, number in versions().items())
    seeds = " and ".join(map(str, tuning.seeds))
    return "\n".join(
        [
            "# The tuning of the baselines",
            "",
            "Made by `python -m tools.tune --out docs/results/tuning.md`: each learned from logs "
            f"of the recorded {tuning.net}, and is judged on its bundled demand (seeds {seeds}), "
            "behind store-and-forward with k = 12. `att_all` in s, means over the seeds. Bold is "
            f"what has the least mean over {' and '.join(CASES)}.",
            "",
            *table(tries, results(tries)),
            "",
            f"{about}.",
            "",
        ]
    )


def main() -> int:
    """Train, run, and print or write the table; the exit status of what failed, if anything."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--only", nargs="+", choices=list(SETTINGS), default=[])
    parser.add_argument("--out", type=Path, help="of the table, instead of printing it")
    parser.add_argument("--workers", type=int, default=1, help="simulations at a time")
    wanted = parser.parse_args()
    tuning, tries = read_tuning(wanted.only)
    FOLDER.mkdir(parents=True, exist_ok=True)
    for trial in tries:
        try:
            status = train(trial)
        except UserError as error:
            print(f"tools.tune: {error}", file=sys.stderr)
            return REFUSED
        if status:
            return status
    suite = FOLDER / "suite.toml"
    suite.write_text(suite_text(tuning, tries), encoding="utf-8")
    words = [str(suite), "--out", str(FOLDER / "batch"), "--no-decisions"]
    if status := run_command("batch", [*words, "--workers", str(wanted.workers)]):
        return status
    text = report(tuning, tries)
    if wanted.out is None:
        print(text)
    else:
        wanted.out.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
