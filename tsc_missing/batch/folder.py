"""The folder of a batch: its plan, its finished runs, its failures.

``runs/NAME`` are run folders, each whole; ``failures/NAME.json`` says why a run has none;
``batch.json`` is what is to be run; ``results.parquet`` is made of these (``table``).
"""

import contextlib
import fcntl
import json
import re
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, TypeAdapter

from tsc_missing.batch.records import (
    Difference,
    Inputs,
    differences,
    known_settings,
)
from tsc_missing.batch.suite import RunSpec, Suite
from tsc_missing.errors import UserError
from tsc_missing.evaluation.run_folder import RUN
from tsc_missing.files import parse, read_json, replace_file

FIELD = "--out"
PLAN = "batch.json"
RUNS = "runs"
FAILURES = "failures"
TABLE = "results.parquet"
LOCK = ".lock"

Kind = Literal["refused", "error", "crash", "timeout"]


class Plan(BaseModel):
    """``batch.json``."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal[1] = 1
    suite: Suite  # its runs that can run
    lacking: dict[str, str] = {}  # methods left out for want of weights, and what makes these
    command: str = ""  # that wrote it


class Failure(BaseModel):
    """``failures/NAME.json``: why a run has no folder."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Kind
    error: str  # one line
    traceback: str = ""
    attempts: int = 1
    versions: dict[str, str] = {}


_PLAN = TypeAdapter(Plan)
_FAILURE = TypeAdapter(Failure)


def check_folder(out: Path) -> None:
    """Raise ``UserError`` unless ``out`` is a batch's folder, or new, or empty."""
    if out.is_dir() and not (out / PLAN).is_file():
        if not all(_of_a_start(path) for path in out.iterdir()):
            raise UserError(
                FIELD, out, "something else is in it; name a new folder or that of a batch"
            )
    elif out.exists() and not out.is_dir():
        raise UserError(FIELD, out, "it is a file; name a new folder or that of a batch")


def _of_a_start(path: Path) -> bool:
    """Whether it may be left of a batch that ended before it had a plan."""
    if path.name in (RUNS, FAILURES) and path.is_dir():
        return not any(path.iterdir())
    return path.name == LOCK or path.name.startswith(f".{PLAN}.")


def read_plan(out: Path, field: str = FIELD) -> Plan:
    """The plan of a batch's folder, without settings that this version does not know."""
    check_is_batch(out, field)
    return parse(_PLAN, _as_known(read_json(out / PLAN, field)), field, out / PLAN)


def check_is_batch(out: Path, field: str) -> None:
    """Raise ``UserError`` unless ``out`` is a batch's folder."""
    if not (out / PLAN).is_file():
        raise UserError(field, out, f"it has no {PLAN}, so it is no folder of tsc-batch")


def _as_known(plan: Any) -> Any:
    try:
        runs = [
            {**run, "settings": known_settings(run["settings"])} for run in plan["suite"]["runs"]
        ]
        return {**plan, "suite": {**plan["suite"], "runs": runs}}
    except (KeyError, TypeError):  # no plan; said where it is parsed
        return plan


def write_plan(out: Path, plan: Plan) -> None:
    """Make the batch's folders and write what is to be run."""
    for folder in (out / RUNS, out / FAILURES):
        folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(plan.model_dump(mode="json"), indent=1) + "\n"
    replace_file(out / PLAN, text.encode())


@contextlib.contextmanager
def held(out: Path) -> Iterator[None]:
    """Keep another batch out of the folder; the system frees it when the process ends.

    ``UserError`` where another has it, or where it cannot be made.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        file = (out / LOCK).open("w")
    except OSError as error:
        raise UserError(FIELD, out, f"cannot be written ({error.strerror})") from error
    with file as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise UserError(FIELD, out, "another tsc-batch is running in it") from None
        yield


def run_folder(out: Path, name: str) -> Path:
    """The folder of a run."""
    return out / RUNS / name


def read_run(out: Path, name: str, field: str = FIELD) -> dict[str, Any] | None:
    """The ``run.json`` of a finished run, None where there is none."""
    path = run_folder(out, name) / RUN
    if not path.is_file():
        if path.parent.exists():
            verdict = f"holds {RUNS}/{name} without a {RUN}"
            raise UserError(field, out, "it is no whole run; remove it", verdict=verdict)
        return None
    found: dict[str, Any] = read_json(path, field)
    return found


def finished_runs(
    out: Path, runs: Iterable[RunSpec], inputs: Inputs, any_version: bool
) -> set[str]:
    """The names of the runs that are there.

    ``UserError`` where a folder of such a name is of other settings, or these came to something
    else, or of other inputs, or, unless ``any_version``, was written by other versions.
    """
    there = set()
    for spec in runs:
        record = read_run(out, spec.name)
        if record is None:
            continue
        for what, difference in differences(record, spec, inputs, any_version):
            _refuse(what, difference, out, spec.name)
        there.add(spec.name)
    return there


def _refuse(what: str, difference: Difference | None, out: Path, name: str) -> None:
    if difference is None:
        return
    place, there, here = difference
    advice = "give another --out"
    if what == "versions":
        advice += ", or --any-version to keep it"
    raise UserError(
        FIELD,
        out,
        f"{place} was {there}, is {here}; {advice}",
        verdict=f"holds {RUNS}/{name} with other {what}",
    )


def clear_leftovers(out: Path, name: str | None = None) -> None:
    """Remove what killed processes left half-written: of one run, or of all."""
    of = re.escape(name) if name is not None else ".+"
    pattern = re.compile(rf"\.{of}\.[a-z0-9_]{{8}}")  # as ``whole_folder`` names them
    for path in (out / RUNS).glob(".*"):
        if pattern.fullmatch(path.name):
            shutil.rmtree(path, ignore_errors=True)


def write_failure(out: Path, name: str, failure: Failure) -> None:
    """Write why a run has no folder."""
    text = json.dumps(failure.model_dump(mode="json"), indent=1) + "\n"
    replace_file(out / FAILURES / f"{name}.json", text.encode())


def read_failure(out: Path, name: str, field: str = FIELD) -> Failure | None:
    """Why a run has no folder, where it was tried."""
    path = out / FAILURES / f"{name}.json"
    return parse(_FAILURE, read_json(path, field), field, path) if path.is_file() else None


def forget_failure(out: Path, name: str) -> None:
    """Drop what is said about a run that is there now."""
    (out / FAILURES / f"{name}.json").unlink(missing_ok=True)
