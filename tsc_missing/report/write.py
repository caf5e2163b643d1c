"""From the folders of batches to the folder of a report."""

import shutil
from collections.abc import Sequence
from pathlib import Path

from tsc_missing.errors import UserError, nearest
from tsc_missing.files import check_writable, whole_folder
from tsc_missing.report.document import FIGURES, make_report
from tsc_missing.report.page import to_html
from tsc_missing.report.pictures import render
from tsc_missing.report.results import read_results
from tsc_missing.report.runs_table import runs_csv

FIELD = "--out"
MARKDOWN, HTML, RUNS = "report.md", "report.html", "runs.csv"
METRICS = (  # result fields of which less is better, which ranks and comparisons go by
    "att_all",
    "att_approach",
    "att_finished",
    "decision_ms_median",
    "decision_ms_p99",
    "depart_delay",
    "imputation_mae",
    "mean_queue",
    "p95_travel_time",
    "stops",
    "time_loss",
    "wall_s",
)


def check_metric(metric: str) -> None:
    """Raise ``UserError`` unless it is a result field that methods can be compared by."""
    if metric not in METRICS:
        raise UserError("--metric", metric, nearest(metric, METRICS))


def check_target(target: Path) -> None:
    """Raise ``UserError`` unless a report can be written there, or replaced."""
    if not target.is_dir():
        check_writable(target, FIELD)
    elif not is_report(target) and any(target.iterdir()):
        raise UserError(FIELD, target, "something else is in it; name a new folder or a report's")


def is_report(folder: Path) -> bool:
    """Whether there is nothing in a folder but a report, with its HTML page or without."""
    names = {path.name for path in folder.iterdir()}
    return {MARKDOWN} <= names <= {MARKDOWN, HTML, RUNS, FIGURES}


def write_report(
    folders: Sequence[Path], target: Path, metric: str, command: str = ""
) -> list[Path]:
    """Write the report of the batches in ``folders``; returns its documents and its table."""
    results = read_results(folders)
    report = make_report(results, metric, command)
    old = target.with_name(f".{target.name}.old")
    fresh = target.with_name(f".{target.name}.new")
    for left in (old, fresh):
        shutil.rmtree(left, ignore_errors=True)
    with whole_folder(fresh, FIELD) as folder:
        (folder / MARKDOWN).write_text(report.markdown, encoding="utf-8")
        images = {picture.name: render(picture.figure, "svg") for picture in report.pictures}
        (folder / HTML).write_text(to_html(report, images), encoding="utf-8")
        (folder / RUNS).write_text(runs_csv(results), encoding="utf-8", newline="")
        if report.pictures:
            (folder / FIGURES).mkdir()
        for picture in report.pictures:
            (folder / FIGURES / f"{picture.name}.png").write_bytes(render(picture.figure, "png"))
    if target.exists():
        target.rename(old)
    fresh.rename(target)
    shutil.rmtree(old, ignore_errors=True)
    return [target / MARKDOWN, target / HTML, target / RUNS]
