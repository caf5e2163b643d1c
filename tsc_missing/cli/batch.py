"""``tsc-batch``: a suite of runs, in parallel, resumable."""

import json
import os
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tsc_missing.cli.common import (
    DONE,
    FAILED,
    FINISHED_KEPT,
    INTERRUPTED,
    make_app,
    messages,
    run_app,
)
from tsc_missing.words import counted

if TYPE_CHECKING:
    from tsc_missing.batch.folder import Failure
    from tsc_missing.batch.run import Batch, Means

app = make_app("Run a suite: many runs in parallel, resumable, into one table of results.")


@app.command()
def batch(
    suite: Annotated[
        str,
        typer.Argument(help="A TOML file, or a bundled suite: smoke, headline, random-missing, …"),
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="The batch's folder; goes on where there is one. Default: runs/NAME."),
    ] = None,
    workers: Annotated[
        int, typer.Option(min=1, help="Simulations at a time; the cores by default.")
    ] = os.cpu_count() or 1,
    cluster: Annotated[
        str | None,
        typer.Option(help="The address of a Dask scheduler, to run on its workers instead."),
    ] = None,
    retries: Annotated[int, typer.Option(min=0, help="Further attempts of a run that failed.")] = 1,
    timeout: Annotated[
        float, typer.Option(min=0.1, help="Seconds that an attempt may take.")
    ] = 3600.0,
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", help="KEY=VALUE for all runs, as demand=recorded or seed=[0,1]."),
    ] = None,
    skip_unavailable: Annotated[
        bool, typer.Option("--skip-unavailable", help="Leave out methods without weights.")
    ] = False,
    any_version: Annotated[
        bool, typer.Option("--any-version", help="Keep finished runs of other versions.")
    ] = False,
    reuse: Annotated[
        list[Path] | None,
        typer.Option(help="Another batch's folder, whose runs are taken where they are the same."),
    ] = None,
    runs_per_process: Annotated[
        int, typer.Option(min=1, help="Runs after which a worker process is replaced.")
    ] = 25,
    decisions: Annotated[
        bool, typer.Option(help="Write decisions.parquet, which plots of queues need.")
    ] = True,
    only_list: Annotated[
        bool, typer.Option("--list", help="Check the suite, print its runs, and run nothing.")
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object and nothing else.")
    ] = False,
) -> int:
    """Run a suite: many runs in parallel, resumable, into one table of results."""
    from tsc_missing.batch.run import Means, prepare_batch
    from tsc_missing.batch.suite import read_suite
    from tsc_missing.batch.worker import Care

    wanted = read_suite(suite, changes or ())
    folder = out if out is not None else Path("runs") / wanted.name
    prepared = prepare_batch(wanted, folder, skip_unavailable, any_version, reuse or ())
    _tell_lacking(prepared)
    _tell_other_versions(prepared)
    if only_list:
        _list(prepared, as_json)
        return DONE
    command = shlex.join(["tsc-batch", *sys.argv[1:]])
    care = Care(timeout, retries, runs_per_process)
    try:
        failures = _watched(prepared, Means(workers, cluster, care, decisions, command))
    except KeyboardInterrupt:
        there = len(prepared.suite.runs) - len(_left(prepared))
        messages().print(
            f"interrupted with {there} of {len(prepared.suite.runs)} runs; the same command goes on"
        )
        raise SystemExit(INTERRUPTED) from None
    _print(prepared, failures, as_json)
    return FAILED if failures else DONE


def _tell_lacking(prepared: "Batch") -> None:
    from tsc_missing.batch.check import lacking_words

    if prepared.lacking:
        messages().print(f"left out, no weights: {lacking_words(prepared.lacking)}", markup=False)


def _tell_other_versions(prepared: "Batch") -> None:
    others = prepared.of_other_versions if prepared.any_version else 0
    if others:
        words = "this version might come to something else"
        messages().print(f"{counted(others, 'run')} of other versions kept: {words}")


def _left(prepared: "Batch") -> list[str]:
    from tsc_missing.batch.folder import run_folder

    return [name for name in _names(prepared) if not run_folder(prepared.out, name).exists()]


def _names(prepared: "Batch") -> list[str]:
    return [run.name for run in prepared.suite.runs]


def _list(prepared: "Batch", as_json: bool) -> None:
    names = _names(prepared)
    if as_json:
        rows = {name: name in prepared.finished for name in names}
        reusable = {name: str(folder) for name, folder in prepared.reusable.items()}
        json.dump({"out": str(prepared.out), "runs": rows, "reusable": reusable}, sys.stdout)
        sys.stdout.write("\n")
        return
    for name in names:
        there = "finished" if name in prepared.finished else "to run  "
        print(f"{'to take ' if name in prepared.reusable else there}  {name}")


def _watched(prepared: "Batch", means: "Means") -> dict[str, "Failure"]:
    from tsc_missing.batch.run import run_batch
    from tsc_missing.cli.batch_progress import batch_progress

    with batch_progress() as watch:
        return run_batch(prepared, means, watch)


def _print(prepared: "Batch", failures: dict[str, "Failure"], as_json: bool) -> None:
    from tsc_missing.batch.folder import FAILURES, RUNS, TABLE

    out, total = prepared.out, len(prepared.suite.runs)
    if as_json:
        summary = {
            "out": str(out),
            "table": str(out / TABLE),
            "runs": total,
            "finished": total - len(failures),
            "failed": {name: failure.error for name, failure in failures.items()},
            "lacking": prepared.lacking,
        }
        json.dump(summary, sys.stdout)
        sys.stdout.write("\n")
        return
    print(f"{total - len(failures)} of {total} runs finished: {out / TABLE}")
    others = {path.name for path in (out / RUNS).glob("[!.]*")} - {*_names(prepared)}
    if others:
        print(f"not in the table: {len(others)} runs in {out / RUNS} that this suite does not have")
    for name, failure in failures.items():
        print(f"failed: {name}: {failure.error} ({out / FAILURES / name}.json)")


def main() -> None:
    """The entry point of ``tsc-batch``."""
    run_app(app, "tsc-batch", FINISHED_KEPT)


if __name__ == "__main__":
    main()
