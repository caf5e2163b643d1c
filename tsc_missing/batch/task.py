"""What a worker process does: one run, from its settings to its folder."""

import contextlib
import os
import traceback
from dataclasses import dataclass
from pathlib import Path

from tsc_missing.batch.folder import Failure
from tsc_missing.batch.records import first_difference
from tsc_missing.config import RunSettings
from tsc_missing.errors import UserError
from tsc_missing.evaluation.closed_loop import Progress
from tsc_missing.evaluation.run import Options, execute, prepare
from tsc_missing.evaluation.run_folder import is_whole
from tsc_missing.versions import versions


@dataclass(frozen=True)
class Task:
    """One run that is wanted."""

    name: str
    settings: RunSettings
    folder: Path
    decisions: bool
    alive: Path  # a file that is there as long as the batch wants its runs
    versions: dict[str, str]  # that the batch wants
    checksums: dict[str, str]  # of what it reads, as it was when the batch began
    home: Path  # where the batch was started: what is named by a relative path is there


class UnwantedError(Exception):
    """Nobody waits for the run any more."""


def run_task(task: Task) -> Failure | None:
    """Make the run's folder; what goes wrong is said, never raised."""
    if is_whole(task.folder):
        return None
    if versions() != task.versions:  # of a worker that joined a cluster later
        words = f"its worker has {versions()}, and the batch {task.versions}"
        return _failure("refused", words)
    with contextlib.suppress(OSError):  # a cluster's worker need not have it
        os.chdir(task.home)
    options = Options(task.folder, task.decisions, durable=True)

    def watch(_: Progress) -> None:
        if not task.alive.exists():
            raise UnwantedError("the batch that started it has ended")

    try:
        prepared = prepare(task.settings, options)
        changed = first_difference(task.checksums, prepared.checksums)
        if changed is not None:
            name, was, now = changed
            return _failure("refused", f"{name} changed since the batch began: was {was}, is {now}")
        execute(prepared, watch)
    except UserError as error:
        if is_whole(task.folder):
            return None
        passing = isinstance(error.__cause__, OSError)  # a full disk; worth another attempt
        return _failure("error" if passing else "refused", str(error))
    except BaseException as error:  # Ctrl-C is not for this process, so it is the run's
        words = " ".join(str(error).split()) or "no message"
        return _failure("error", f"{type(error).__name__}: {words}", traceback.format_exc())
    return None


def _failure(kind: str, error: str, trace: str = "") -> Failure:
    return Failure.model_validate(
        {"kind": kind, "error": error, "traceback": trace, "versions": versions()}
    )
