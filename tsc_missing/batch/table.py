"""The table of a batch: a row a run, made of the run folders so that it cannot disagree."""

import io
import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from tsc_missing.batch.folder import (
    FIELD,
    TABLE,
    Failure,
    read_failure,
    read_plan,
    read_run,
    run_folder,
)
from tsc_missing.batch.keys import dotted, leaves
from tsc_missing.batch.suite import RunSpec
from tsc_missing.evaluation.metrics import Result
from tsc_missing.evaluation.run_folder import MASK, TRIPS
from tsc_missing.files import replace_file, sha256

FINISHED, FAILED, WAITING = "finished", "failed", "not run"
SPEC = ("dataset", "case", "method", "paper", "trained")

KINDS = {int: pa.int64(), float: pa.float64(), bool: pa.bool_(), str: pa.string()}

Row = dict[str, Any]


def read_rows(out: Path, field: str = FIELD) -> list[Row]:
    """A row for each run of the batch's plan, finished or not, in the plan's order.

    ``field`` is what named the folder, for errors.
    """
    return [_row(out, spec, field) for spec in read_plan(out, field).suite.runs]


def _row(out: Path, spec: RunSpec, field: str) -> Row:
    record = read_run(out, spec.name, field)
    failure = read_failure(out, spec.name, field) if record is None else None
    status = FINISHED if record is not None else FAILED if failure is not None else WAITING
    return {
        "run": spec.name,
        "status": status,
        **{key: getattr(spec, key) for key in SPEC},
        **_settings(spec),
        **_result(record),
        **_origin(out, spec.name, record, failure),
    }


def _settings(spec: RunSpec) -> Row:
    return {dotted(key): value for key, value in leaves(spec.settings.model_dump(mode="json"))}


def _result(record: dict[str, Any] | None) -> Row:
    """The result fields, null for a run that is not there; ``demand`` counts vehicles here."""
    values = record["result"] if record is not None else {}
    found = {name: values.get(name) for name in Result.model_fields}
    return {"demand_vehicles": found.pop("demand"), **found}  # ``demand`` is a setting too


def _origin(out: Path, name: str, record: dict[str, Any] | None, failure: Failure | None) -> Row:
    """What the row comes from: versions, files, and why it has no result."""
    found = record or {}
    made_by = found.get("versions") or (failure.versions if failure is not None else {})
    folder = run_folder(out, name)
    files = {f"{file}_sha256": folder / file for file in (TRIPS, MASK)}
    return {
        "scenario": found.get("scenario"),
        "demand_kind": found.get("demand"),
        "fallback_error": found.get("fallback_error"),
        "error": failure.error if failure is not None else None,
        "attempts": failure.attempts if failure is not None else None,
        "versions": json.dumps(made_by, sort_keys=True) if made_by else None,
        "git": found.get("git"),
        "checksums": json.dumps(found["checksums"], sort_keys=True) if found else None,
        **{key: sha256(path) if path.is_file() else None for key, path in files.items()},
    }


def write_table(out: Path) -> Path:
    """Write ``results.parquet`` anew; returns its path."""
    rows = read_rows(out)
    table = pa.Table.from_pylist(rows, schema=_schema(rows))
    buffer = io.BytesIO()
    pq.write_table(table, buffer)
    replace_file(out / TABLE, buffer.getvalue())
    return out / TABLE


def _schema(rows: list[Row]) -> Any:
    """Types by column: what the result's fields are declared as, else that of what is there."""
    declared = {name: field.annotation for name, field in Result.model_fields.items()}
    declared["demand_vehicles"] = declared.pop("demand")
    fields = []
    for key in rows[0]:
        kind: Any = declared.get(key)
        types = {type(row[key]) for row in rows if row[key] is not None}
        if kind not in KINDS:
            kind = float if key in declared or types == {int, float} else next(iter(types), str)
        fields.append((key, KINDS[kind]))
    return pa.schema(fields)
