"""Batches on disk without a simulation: results that are made up, so that tables are known."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tsc_missing.batch.folder import Plan, run_folder, write_plan
from tsc_missing.batch.suite import RunSpec, read_suite
from tsc_missing.evaluation.metrics import Result
from tsc_missing.evaluation.scenario import find_scenario
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.report.results import Results
from tsc_missing.sensing.masks import save_mask
from tsc_missing.sensing.patterns import draw_mask

STEPS = 8

SUITE = """
title = "Made | up"
about = "Of <no> meaning."
paper = ["random-missing", "kriging-missing"]
[methods."Diff_Light"]
controller = "difflight"
paper = "DiffLight"
[methods."rate 10"]
controller = "difflight"
diffusion.weights = "w10"
trained = "random 10 %"
[methods."rate 50"]
controller = "difflight"
diffusion.weights = "w50"
trained = "random 50 %"
[[runs]]
method = ["Diff_Light", "max-queue", "max-pressure", "delay_based"]
net = "jinan_1"
missing = [
    { pattern = "random", rate = 0.5 },
    { pattern = "none" },
    { pattern = "random", rate = 0.1 },
    { pattern = "kriging", rate = 0.25 },
]
seed = [0, 1, 2]
[[runs]]
method = ["rate 10", "rate 50"]
net = "jinan_1"
missing = { pattern = "random", rate = [0.1, 0.5] }
seed = [0, 1, 2]
"""

LEVEL = {  # s, of att_all, by method
    "Diff_Light": 290.0,
    "max-queue": 300.0,
    "max-pressure": 350.0,
    "delay_based": 200.0,
    "rate 10": 310.0,
    "rate 50": 305.0,
}


def att(spec: RunSpec) -> float:
    """A travel time [s] that is known: by method, more with more missing, and by seed."""
    seed, rate = spec.settings.seed, spec.settings.missing.rate
    more = {"rate 10": 100.0}.get(spec.method, 20.0)
    return LEVEL[spec.method] + more * rate + 3.0 * seed


def make_batch(out: Path, tmp_path: Path, decisions: bool = False, skip: str = "") -> Path:
    """A batch's folder; runs whose name holds ``skip`` are not there."""
    file = tmp_path / "made-up.toml"
    file.write_text(SUITE)
    suite = read_suite(str(file))
    write_plan(out, Plan(suite=suite, command="tsc-batch made-up.toml"))
    network = find_scenario("jinan_1", "auto").folder.network
    for spec in suite.runs:
        if skip and skip in spec.name:
            continue
        folder = run_folder(out, spec.name)
        folder.mkdir()
        (folder / "run.json").write_text(json.dumps(record(spec)))
        mask = draw_mask(spec.settings.missing, network, STEPS, spec.settings.seed)
        save_mask(folder / "mask.npz", mask, network.ids)
        if decisions:
            write_decisions(folder / "decisions.parquet", network.n, spec.settings.seed)
    return out


def record(spec: RunSpec) -> dict[str, Any]:
    values: dict[str, Any] = dict.fromkeys(Result.model_fields, 0)
    seconds = att(spec)
    holes = spec.settings.missing.pattern != "none" and spec.method != "delay_based"
    values |= {
        "att_all": seconds,
        "att_approach": seconds - 60,
        "att_finished": None,
        "gridlock": False,
        "imputation_mae": seconds / 100 if holes else None,
        "decision_ms_median": None if spec.method == "delay_based" else 1.5,
    }
    return {
        "settings": spec.settings.model_dump(mode="json"),
        "scenario": "jinan_1",
        "demand": "profile",
        "versions": {"libsumo": "1.28.0"},
        "git": "abc",
        "checksums": find_scenario("jinan_1", "auto").checksums(),
        "fallback_error": "",
        "result": Result.model_validate(values).model_dump(mode="json"),
    }


def with_settings(results: Results, change: Callable[[RunSpec], dict[str, Any]]) -> Results:
    """The results as of runs with other groups of settings: ``change`` gives those of each."""
    runs = []
    for run in results.runs:
        settings = run.spec.settings.model_copy(update=change(run.spec))
        runs.append(replace(run, spec=run.spec.model_copy(update={"settings": settings})))
    return Results(results.plans, runs)


def write_decisions(path: Path, n: int, seed: int) -> None:
    queue = np.random.default_rng(seed).integers(0, 9, STEPS * n * N_SLOTS).astype(np.float32)
    table = {
        "step": np.repeat(np.arange(STEPS), n),
        "time": np.repeat(15.0 * np.arange(STEPS), n),
        "queue": pa.FixedSizeListArray.from_arrays(pa.array(queue), N_SLOTS),
    }
    pq.write_table(pa.table(table), path)
