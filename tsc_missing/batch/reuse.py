"""Finished runs of other batches that a batch wants too: the paper's tables share many."""

import json
import shutil
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from tsc_missing.batch.folder import RUNS, check_is_batch, read_run, run_folder
from tsc_missing.batch.records import Inputs, differences
from tsc_missing.batch.suite import RunSpec
from tsc_missing.evaluation.run_folder import DECISIONS
from tsc_missing.files import whole_folder

FIELD = "--reuse"


def find_reusable(
    batches: Iterable[Path],
    runs: Iterable[RunSpec],
    inputs: Inputs,
    any_version: bool,
) -> dict[str, Path]:
    """The folder of another batch's run for each of ``runs`` that has been made there.

    It has the same settings, which came to the same, inputs (by checksum) and, unless
    ``any_version``, versions, whatever its name; other versions may know other settings. Raises
    ``UserError`` for a folder that is no batch's.
    """
    there = _by_scene(batches)
    found = {}
    for spec in runs:
        scene = _scene(spec.settings.model_dump(mode="json"))
        for folder, record in there.get(scene, ()):
            if not any(d for _, d in differences(record, spec, inputs, any_version)):
                found[spec.name] = folder
                break
    return found


def take(folder: Path, out: Path, name: str, decisions: bool) -> bool:
    """Copy a run into a batch, whole or not at all; returns whether it was taken.

    One without the step-by-step table is not, where ``decisions`` are wanted.
    """
    if decisions and not (folder / DECISIONS).is_file():
        return False
    with whole_folder(run_folder(out, name), FIELD, durable=True) as copy:
        shutil.copytree(folder, copy, dirs_exist_ok=True)
    return True


def _by_scene(batches: Iterable[Path]) -> dict[str, list[tuple[Path, dict[str, Any]]]]:
    found = defaultdict(list)
    for batch in batches:
        check_is_batch(batch, FIELD)
        for folder in sorted((batch / RUNS).glob("[!.]*")):
            record = read_run(batch, folder.name, FIELD)
            if record is not None and isinstance(record.get("settings"), dict):
                found[_scene(record["settings"])].append((folder, record))
    return found


def _scene(settings: dict[str, Any]) -> str:
    """What a run can be looked up by; runs of one scene may still differ."""
    return json.dumps([settings.get(key) for key in ("net", "controller", "seed")])
