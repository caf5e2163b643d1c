"""Many runs in processes of their own, for the tools that make tables."""

import multiprocessing
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from tools.datasets import Dataset
from tsc_missing.config import RunSettings
from tsc_missing.evaluation.metrics import Result
from tsc_missing.evaluation.run import Options, execute, prepare
from tsc_missing.network.importing import import_cityflow

HORIZON = 3600  # [s]


def run_command(name: str, words: Sequence[str]) -> int:
    """Print and run ``tsc-NAME`` in a process of its own; its exit status."""
    print(f"tsc-{name} {' '.join(words)}", flush=True)
    return subprocess.run([sys.executable, "-m", f"tsc_missing.cli.{name}", *words]).returncode


def run_one(settings: RunSettings) -> Result:
    """The result of a run that keeps no folder."""
    return execute(prepare(settings, Options()))


def run_all(settings: Sequence[RunSettings], workers: int) -> list[Result]:
    """All results, each from a process of its own, in the order of the settings."""
    context = multiprocessing.get_context("spawn")
    with context.Pool(workers, maxtasksperchild=1) as pool:
        return pool.map(run_one, settings, chunksize=1)


def import_dataset(dataset: Dataset, shared: Path, scratch: Path) -> str:
    """Import a dataset's recorded flow below ``scratch``; returns what ``net`` must be."""
    folder = scratch / dataset.name
    files = dataset.roadnet(shared), dataset.flow(shared)
    import_cityflow(*files, folder, dataset.name, HORIZON)
    return str(folder)


def seconds(result: Result) -> float:
    """``att_all`` [s]."""
    assert result.att_all is not None
    return result.att_all
