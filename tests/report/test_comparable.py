"""Runs that a report would compare or average, and must not."""

import json

import pytest

from tests.report.cases import make_batch
from tsc_missing.errors import UserError
from tsc_missing.report.results import read_results

HALF = "random 50 %"


@pytest.fixture
def folder(tmp_path):
    return make_batch(tmp_path / "b", tmp_path)


def plan_again(folder, wanted, **changes):
    """The batch's plan with other settings of the runs that are ``wanted``; a dict is merged."""
    plan = json.loads((folder / "batch.json").read_text())
    for run in plan["suite"]["runs"]:
        if wanted(run):
            for key, value in changes.items():
                old = run["settings"][key]
                run["settings"][key] = {**old, **value} if isinstance(value, dict) else value
    (folder / "batch.json").write_text(json.dumps(plan))


def with_checksum(folder, pattern, **digests):
    for path in (folder / "runs").glob(f"{pattern}/run.json"):
        record = json.loads(path.read_text())
        path.write_text(json.dumps({**record, "checksums": {**record["checksums"], **digests}}))


def refused(folder, words):
    with pytest.raises(UserError, match=f"cannot be compared: {words}.*reports of their own"):
        read_results([folder])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"horizon": 1800}, "horizon is 1800; .* is 3600"),
        ({"volume": 2.0}, "volume is 2.0"),
        ({"vehicle": {"tau": 1.5}}, "vehicle.tau is 1.5; .* is 2.0"),
        ({"sensor": {"kind": "area"}}, "sensor.kind is area"),
    ],
)
@pytest.mark.parametrize("which", ["seed", "case"])
def test_another_world_for_a_seed_or_a_case(folder, changes, words, which):
    wanted = {
        "seed": lambda run: run["settings"]["seed"] == 1,
        "case": lambda run: run["case"] == "kriging 25 %",
    }
    plan_again(folder, wanted[which], **changes)
    refused(folder, words)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"imputer": "last"}, "imputer is last; .* is sfm-4"),
        ({"signals": {"min_space": 9}}, "signals.min_space is 9; .* is None"),
        ({"missing": {"rate": 0.504}}, "missing.rate is 0.504"),
    ],
)
def test_other_settings_in_a_cell(folder, changes, words):
    plan_again(folder, lambda r: (r["case"], r["settings"]["seed"]) == (HALF, 1), **changes)
    refused(folder, words)


@pytest.mark.parametrize("name", ["weights: lookahead", "code: mine.py:Mine"])
def test_other_weights_or_code_of_a_method(folder, name):
    with_checksum(folder, "*-Diff_Light-*", **{name: "abc"})
    read_results([folder])
    with_checksum(folder, "*-kriging-*-Diff_Light-*", **{name: "def"})
    refused(folder, f"{name} is def; .* is abc")


def test_seeds_and_methods_may_have_weights_of_their_own(folder):
    for seed in (0, 1, 2):
        with_checksum(folder, f"*-Diff_Light-seed{seed}", **{f"weights: w-{seed}": str(seed)})
    plan_again(folder, lambda run: run["method"] == "max-queue", imputer="last")
    plan_again(folder, lambda run: run["settings"]["seed"] == 1, mask_seed=7, net="./jinan_1")
    read_results([folder])


def test_lists_of_outages_are_one_in_a_cell_and_replayed_masks_are_not(folder):
    one = {"pattern": "file", "rate": 0.0, "file": "outages.csv"}
    plan_again(folder, lambda run: run["case"] == HALF, missing=one)
    for seed in (0, 1, 2):
        with_checksum(folder, f"*-random-0.5-*-seed{seed}", **{"mask: outages.csv": str(seed)})
    refused(folder, "mask: outages.csv is 1; .* is 0")
    plan_again(folder, lambda run: run["case"] == HALF, missing={"file": "a/mask.npz"})
    read_results([folder])
