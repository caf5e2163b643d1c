"""The runs of a report as a table for spreadsheets and other programs."""

import csv
import io

from tsc_missing.evaluation.metrics import Result
from tsc_missing.evaluation.run_folder import TRIPS
from tsc_missing.report.results import Results

DECIMALS = 4
WHAT = ("run", "dataset", "case", "method")
RESULT = ("demand_vehicles", *(name for name in Result.model_fields if name != "demand"))
ORIGIN = ("git", f"{TRIPS}_sha256")


def runs_csv(results: Results) -> str:
    """A line for each finished run: what ran, its result fields, and what it can be checked by.

    Numbers have 4 decimals at the most; a field that is null is empty.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*WHAT, "seed", "mask_seed", *RESULT, *ORIGIN])
    for run in results.finished:
        seeds = (run.spec.settings.seed, run.spec.settings.seed_of_mask)
        what = [run.row[name] for name in WHAT]
        found = [_short(run.row[name]) for name in (*RESULT, *ORIGIN)]
        writer.writerow([*what, *seeds, *found])
    return text.getvalue()


def _short(value: object) -> object:
    return round(value, DECIMALS) if isinstance(value, float) else value
