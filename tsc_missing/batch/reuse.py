"""Finished runs of other batches that a batch wants too: the paper's tables share many."""

import json
import shutil
from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from tsc_missing.batch.folder import RUNS, known_settings, read_plan, read_run, run_folder
from tsc_missing.batch.suite import RunSpec
from tsc_missing.evaluation.run import checksums, inputs_of
from tsc_missing.evaluation.run_folder import DECISIONS
from tsc_missing.evaluation.scenario import Scenario
from tsc_missing.files import whole_folder
from tsc_missing.versions import versions

FIELD = "--reuse"


def find_reusable(
    batches: Iterable[Path],
    runs: Iterable[RunSpec],
    scenarios: Mapping[str, Scenario],
    any_version: bool,
) -> dict[str, Path]:
    """The folder of another batch's run for each of ``runs`` that has been made there.

    It has the same settings, inputs (by checksum) and, unless ``any_version``, versions, whatever
    its name; other versions may know other settings. Raises ``UserError`` for a folder that is no
    batch's.
    """
    there = _by_scene(batches)
    known: dict[tuple[object, ...], dict[str, str]] = {}
    found = {}
    for spec in runs:
        settings = spec.settings
        wanted = settings.model_dump(mode="json")
        key = inputs_of(settings)
        for folder, record in there.get(_scene(wanted), ()):
            if not _is_same(record, wanted, any_version):
                continue
            if key not in known:
                known[key] = checksums(settings, scenarios[spec.name])
            if record.get("checksums") == known[key]:
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


def _is_same(record: dict[str, Any], wanted: dict[str, Any], any_version: bool) -> bool:
    found = record["settings"]
    if any_version:
        return bool(known_settings(found) == wanted)
    return bool(found == wanted and record.get("versions") == versions())


def _by_scene(batches: Iterable[Path]) -> dict[str, list[tuple[Path, dict[str, Any]]]]:
    found = defaultdict(list)
    for batch in batches:
        read_plan(batch, FIELD)
        for folder in sorted((batch / RUNS).glob("[!.]*")):
            record = read_run(batch, folder.name)
            if record is not None and isinstance(record.get("settings"), dict):
                found[_scene(record["settings"])].append((folder, record))
    return found


def _scene(settings: dict[str, Any]) -> str:
    """What a run can be looked up by; runs of one scene may still differ."""
    return json.dumps([settings.get(key) for key in ("net", "controller", "seed")])
