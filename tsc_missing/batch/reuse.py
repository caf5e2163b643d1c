"""Finished runs of other batches that a batch wants too: the paper's tables share many."""

import json
import shutil
from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from tsc_missing.batch.folder import RUNS, read_plan, read_run, run_folder
from tsc_missing.batch.suite import RunSpec
from tsc_missing.controllers.registry import weights_of
from tsc_missing.evaluation.run import checksums
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
    its name. Raises ``UserError`` for a folder that is no batch's.
    """
    there = _by_settings(batches)
    known: dict[tuple[object, ...], dict[str, str]] = {}
    found = {}
    for spec in runs:
        settings = spec.settings
        key = (settings.net, settings.demand, weights_of(settings))
        for folder, record in there.get(_words(settings.model_dump(mode="json")), ()):
            if not any_version and record.get("versions") != versions():
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


def _by_settings(batches: Iterable[Path]) -> dict[str, list[tuple[Path, dict[str, Any]]]]:
    found = defaultdict(list)
    for batch in batches:
        read_plan(batch, FIELD)
        for folder in sorted((batch / RUNS).glob("[!.]*")):
            record = read_run(batch, folder.name)
            if record is not None:
                found[_words(record.get("settings"))].append((folder, record))
    return found


def _words(settings: Any) -> str:
    return json.dumps(settings, sort_keys=True)
