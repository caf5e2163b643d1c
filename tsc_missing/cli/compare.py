"""``tsc-compare``: single runs beside each other, or the intersections of one."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tsc_missing.cli.common import make_app, run_app
from tsc_missing.errors import UserError, nearest

if TYPE_CHECKING:
    from tsc_missing.report.compare import Comparison

EACH = ("intersection", "movement")
HELP = "Show what became of the intersections of a run, or what differs between runs and where."

app = make_app(HELP)


@app.command(help=HELP)
def compare(
    runs: Annotated[
        list[Path], typer.Argument(help="Run folders; the first is what others are compared with.")
    ],
    rows: Annotated[
        int, typer.Option(help="How many intersections are printed, the worst first. 0: all.")
    ] = 10,
    each: Annotated[str, typer.Option(help="A row for each intersection or movement.")] = EACH[0],
    csv: Annotated[
        Path | None, typer.Option(help="Write the rows, all of them, as CSV, with more columns.")
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            help="Draw the network (.png, .svg, .pdf) with each intersection's delay, "
            "of two runs its change."
        ),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object and nothing else.")
    ] = False,
) -> None:
    """Compare run folders."""
    from tsc_missing.report.compare import compare as read
    from tsc_missing.report.compare_files import as_json as whole
    from tsc_missing.report.compare_files import check_csv_path, write_csv

    if rows < 0:
        raise UserError("rows", rows, "it must be 0 (all) or more")
    if each not in EACH:
        raise UserError("each", each, nearest(each, EACH))
    if csv is not None:
        check_csv_path(csv, "csv")
    if picture is not None:
        _check_picture(picture, runs)
    comparison = read(runs, "movement" if each == "movement" else "intersection")
    if picture is not None:
        _draw(comparison if each == EACH[0] else read(runs, "intersection"), picture)
    if csv is not None:
        write_csv(comparison, csv, "csv")
    if as_json:
        json.dump(whole(comparison), sys.stdout)
        sys.stdout.write("\n")
        return
    from tsc_missing.cli.compare_table import print_comparison

    print_comparison(comparison, rows, [path for path in (csv, picture) if path is not None])


def _check_picture(path: Path, runs: list[Path]) -> None:
    from tsc_missing.network.picture import check_picture_path

    check_picture_path(path, "picture")
    if len(runs) > 2:
        words = "a picture is of one run or of the difference between two"
        raise UserError("picture", path, words, verdict=f"cannot show {len(runs)} runs")


def _draw(by_intersection: "Comparison", path: Path) -> None:
    from tsc_missing.network.picture import save_picture
    from tsc_missing.report.delay_map import delay_map

    save_picture(delay_map(by_intersection, "picture"), path, "picture")


def main() -> None:
    """The entry point of ``tsc-compare``."""
    run_app(app, "tsc-compare")


if __name__ == "__main__":
    main()
