"""A comparison of runs as a JSON object and as a table for spreadsheets."""

import os
from pathlib import Path

from tsc_missing.errors import UserError
from tsc_missing.files import replace_file, written_into
from tsc_missing.report.compare import Change, Comparison, FinishedRun, difference
from tsc_missing.report.csv_text import csv_text

CSV = ".csv"


def as_json(comparison: Comparison) -> dict[str, object]:
    """All of it, with all places."""
    return {
        "runs": [{"folder": str(r.folder), **r.file.model_dump()} for r in comparison.runs],
        "differing": comparison.differing,
        "warnings": comparison.warnings,
        "result_changes": [_result_changes(comparison, run) for run in comparison.runs[1:]],
        "each": comparison.each,
        "places": [_as_json(change) for change in comparison.changes],
    }


def _result_changes(comparison: Comparison, run: FinishedRun) -> dict[str, object]:
    base = comparison.runs[0].file.result
    found = {name: difference(base.get(name), it) for name, it in run.file.result.items()}
    return {
        name: {"difference": more, "percent": percent}
        for name, (more, percent) in found.items()
        if more is not None
    }


def _as_json(change: Change) -> dict[str, object]:
    first = change.places[0]
    called = {"intersection": first.intersection, "movement": first.movement}
    return {
        **{key: value for key, value in called.items() if value is not None},
        "runs": [place.values() for place in change.places],
        "delay_changes": list(change.delays),
    }


def check_csv_path(path: Path, field: str) -> None:
    """Raise ``UserError`` unless a file can be written to ``path``; leaves nothing behind."""
    folder = path.absolute().parent
    if path.is_dir():
        raise UserError(field, path, "it is a folder; give the name of a file")
    if path.suffix != CSV:  # a slip must not cost a file of a run
        raise UserError(field, path, f"its name must end in {CSV}")
    if not folder.is_dir():
        raise UserError(field, path, f"there is no folder {folder}")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise UserError(field, path, f"no permission to write in {folder}")


def write_csv(comparison: Comparison, path: Path, field: str) -> None:
    """Write a row a place, the worst first; columns end in the run's number if there are more.

    The file is whole or not there; an older one is replaced.
    """
    text = csv_text([_flat(change) for change in comparison.changes])
    with written_into(path, field):
        replace_file(path, text.encode())


def _flat(change: Change) -> dict[str, object]:
    first, several = change.places[0], len(change.places) > 1
    row: dict[str, object] = {"intersection": first.intersection}
    if first.movement is not None:
        row["movement"] = first.movement
    for number, place in enumerate(change.places, start=1):
        ending = f"_{number}" if several else ""
        row |= {f"{name}{ending}": value for name, value in place.values().items()}
        if number > 1:
            row[f"delay_change{ending}"] = change.delays[number - 2]
    return row
