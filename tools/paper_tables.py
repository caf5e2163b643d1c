"""Every table of the paper: the suites that repeat them, one after the other, and their reports.

    python -m tools.paper_tables --set demand=recorded
    python -m tools.paper_tables --only limits cql-model-based --reuse runs/headline

Runs `tsc-batch` and `tsc-report`, which it prints first. A run that several tables share is made
once (`--reuse`); what is there is not made again; stopped at any moment, the same command goes on.
Methods without weights are left out (docs/batches.md says what makes them), and so is a suite in
which that is all of them.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tools.runs import run_command
from tsc_missing.batch.check import available
from tsc_missing.batch.folder import PLAN
from tsc_missing.batch.suite import read_suite
from tsc_missing.cli.common import DONE, FAILED, MISTAKE
from tsc_missing.errors import UserError

SUITES = (
    "no-missing",
    "random-missing",
    "kriging",
    "limits",
    "unobserved-locations",
    "cql-model-based",
    "sampling-steps",
    "newyork-random",
    "newyork-kriging",
    "ablation",
    "dcm-ablation",
    "inverse-dynamics-ablation",
    "generalisation",
)
"""Those of the paper, the shared runs first."""


def batch_words(suite: str, wanted: argparse.Namespace) -> list[str]:
    """The arguments of ``tsc-batch``."""
    out = wanted.runs / suite
    earlier = [wanted.runs / name for name in SUITES[: SUITES.index(suite)]]
    others = [*wanted.reuse, *(path for path in earlier if (path / PLAN).is_file())]
    words = [suite, "--out", str(out), "--skip-unavailable", "--workers", str(wanted.workers)]
    words += ["--any-version"] if wanted.any_version else []
    words += [word for change in wanted.changes for word in ("--set", change)]
    return words + [word for path in others for word in ("--reuse", str(path))]


def arguments(given: Sequence[str] | None = None) -> argparse.Namespace:
    """What is wanted."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--only", nargs="+", choices=SUITES, default=list(SUITES))
    parser.add_argument("--runs", type=Path, default=Path("runs"), help="where the batches go")
    parser.add_argument("--out", type=Path, help="where reports go; default: into the batches")
    parser.add_argument("--reuse", type=Path, action="append", default=[], help="other batches")
    parser.add_argument("--any-version", action="store_true", help="take runs of other versions")
    parser.add_argument("--set", dest="changes", action="append", default=[], help="KEY=VALUE")
    parser.add_argument("--workers", type=int, default=2, help="simulations at a time")
    return parser.parse_args(given)


def has_nothing_to_run(suite: str, changes: Sequence[str]) -> bool:
    """Whether no method of a suite has weights here."""
    try:
        return not available(read_suite(suite, changes).runs, skip=True)[0]
    except UserError:
        return False


def main() -> int:
    """Run and report each suite; the exit status of the first that failed, after all were tried.

    A suite in which nothing can run is no failure, and one of which some runs failed is reported.
    """
    wanted, status = arguments(), 0
    for suite in wanted.only:
        failed = run_command("batch", batch_words(suite, wanted))
        if failed == MISTAKE and has_nothing_to_run(suite, wanted.changes):
            print(f"{suite}: left out, no method of it has weights here", flush=True)
            continue
        target = wanted.out / suite if wanted.out else wanted.runs / suite / "report"
        if failed in (DONE, FAILED):  # of what is finished, where some runs failed
            report = run_command("report", [str(wanted.runs / suite), "--out", str(target)])
            failed = failed or report
        status = status or failed
    return status


if __name__ == "__main__":
    sys.exit(main())
