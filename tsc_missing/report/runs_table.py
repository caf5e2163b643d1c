"""The runs of a report as a table for spreadsheets and other programs."""

from tsc_missing.evaluation.metrics import Result
from tsc_missing.evaluation.run_folder import TRIPS
from tsc_missing.report.csv_text import csv_text
from tsc_missing.report.results import Results, Run

WHAT = ("run", "dataset", "case", "method")
RESULT = ("demand_vehicles", *(name for name in Result.model_fields if name != "demand"))
ORIGIN = ("git", f"{TRIPS}_sha256")


def runs_csv(results: Results) -> str:
    """A line for each finished run: what ran, its result fields, and what it can be checked by."""
    return csv_text([_line(run) for run in results.finished])


def _line(run: Run) -> dict[str, object]:
    settings = run.spec.settings
    seeds = {"seed": settings.seed, "mask_seed": settings.seed_of_mask}
    what = {name: run.row[name] for name in WHAT}
    return {**what, **seeds, **{name: run.row[name] for name in (*RESULT, *ORIGIN)}}
