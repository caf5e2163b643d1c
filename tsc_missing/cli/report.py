"""``tsc-report``: tables and figures of batches."""

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from tsc_missing.cli.common import make_app, run_app

app = make_app("Make a report of batches: report.md with figures, one HTML file, and runs.csv.")


@app.command()
def report(
    results: Annotated[
        list[Path], typer.Argument(help="The folders of one or more batches, as runs/headline.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            help="The report's folder, where an earlier report is replaced. "
            "Default: report/ in the first of RESULTS."
        ),
    ] = None,
    metric: Annotated[
        str, typer.Option(help="The result field that is reported (docs/metrics.md).")
    ] = "att_all",
) -> None:
    """Make a report of batches: report.md with figures, one HTML file, and runs.csv."""
    from tsc_missing.report.write import check_metric, check_target, write_report

    target = out if out is not None else results[0] / "report"
    check_metric(metric)
    check_target(target)
    command = shlex.join(["tsc-report", *sys.argv[1:]])
    for path in write_report(results, target, metric, command):
        print(path)


def main() -> None:
    """The entry point of ``tsc-report``."""
    run_app(app, "tsc-report")


if __name__ == "__main__":
    main()
