"""A batch: what is missing of a suite is run, and its table is written."""

import contextlib
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from tsc_missing.batch.check import LACKING, METHODS, available, check_scenarios, lacking_words
from tsc_missing.batch.engine import Engine, alive_file, cluster_engine, local_engine, run_tasks
from tsc_missing.batch.folder import (
    FIELD,
    PLAN,
    RUNS,
    Failure,
    Plan,
    check_folder,
    clear_leftovers,
    finished_runs,
    forget_failure,
    held,
    read_failure,
    run_folder,
    write_failure,
    write_plan,
)
from tsc_missing.batch.records import Inputs
from tsc_missing.batch.reuse import find_reusable, take
from tsc_missing.batch.suite import RunSpec, Suite
from tsc_missing.batch.table import write_table
from tsc_missing.batch.task import Task
from tsc_missing.batch.worker import Care, Outcome
from tsc_missing.controllers.resolved import uses_weights
from tsc_missing.errors import UserError
from tsc_missing.evaluation.run_folder import RUN, is_whole
from tsc_missing.evaluation.scenario import Scenario
from tsc_missing.files import read_json
from tsc_missing.versions import versions


@dataclass(frozen=True)
class Batch:
    """A suite that has been checked and can start."""

    suite: Suite  # its runs that can run
    lacking: dict[str, str]  # methods left out for want of weights, and what makes these
    scenarios: dict[str, Scenario]  # by run
    finished: frozenset[str]  # names of the runs that are there
    out: Path
    inputs: Inputs  # of its runs
    reusable: dict[str, Path] = field(default_factory=dict)  # runs of other batches, by name here
    any_version: bool = False  # whether runs of other versions count as finished

    @property
    def missing(self) -> tuple[RunSpec, ...]:
        """What is to be run, the longest first."""
        left = [run for run in self.suite.runs if run.name not in self.finished]
        return tuple(sorted(left, key=self._length, reverse=True))

    @property
    def of_other_versions(self) -> int:
        """How many of the runs that are there, or are taken, other versions made."""
        folders = [run_folder(self.out, name) for name in self.finished]
        records = (read_json(path / RUN, FIELD) for path in (*folders, *self.reusable.values()))
        return sum(record.get("versions") != versions() for record in records)

    def _length(self, run: RunSpec) -> tuple[bool, int, int]:
        network = self.scenarios[run.name].folder.network
        return uses_weights(run.settings), network.n, run.settings.horizon


@dataclass(frozen=True)
class Means:
    """What a batch is run with; none of it changes a result."""

    workers: int = 1
    cluster: str | None = None  # the address of a Dask scheduler, instead of own workers
    care: Care = field(default_factory=Care)
    decisions: bool = True  # write decisions.parquet
    command: str = ""  # for the record


@dataclass(frozen=True)
class State:
    """How far a batch is."""

    done: int  # runs that are there
    failed: int
    running: int
    wanted: int
    last: Outcome | None  # that ended just now


Watch = Callable[[Callable[[], State]], None]


def prepare_batch(
    suite: Suite, out: Path, skip: bool, any_version: bool, reuse: Sequence[Path] = ()
) -> Batch:
    """Find everything that is wrong before anything starts, and what is there already.

    ``reuse`` are folders of other batches whose runs are taken where they are the same.
    """
    check_folder(out)
    runs, lacking = available(suite.runs, skip)
    scenarios = check_scenarios(runs)
    inputs = Inputs(scenarios)
    finished = finished_runs(out, runs, inputs, any_version)
    left = [run for run in runs if run.name not in finished]
    reusable = find_reusable(reuse, left, inputs, any_version)
    suite = suite.model_copy(update={"runs": runs})
    return Batch(suite, lacking, scenarios, frozenset(finished), out, inputs, reusable, any_version)


def run_batch(batch: Batch, means: Means, watch: Watch | None = None) -> dict[str, Failure]:
    """Run what is missing; returns the failures by run.

    ``watch`` is called at the start and whenever a run ended, with what tells the state. Ended
    early, the runs that are finished stay and the table tells of them. Where it cannot start, or
    no run is left of the suite (``UserError``), a new folder without a run goes away again.
    """
    if not batch.suite.runs:
        words = lacking_words(batch.lacking)
        raise UserError(METHODS, words, "nothing else is in the suite; make some", LACKING)
    with held(batch.out):
        new = not (batch.out / PLAN).exists()
        try:
            _run_batch(_as_it_is_now(batch), means, watch)
        except (UserError, OSError) as error:
            if new and not any((batch.out / RUNS).glob("[!.]*")):
                shutil.rmtree(batch.out, ignore_errors=True)
            if isinstance(error, OSError):
                raise UserError(FIELD, batch.out, f"cannot be written ({error})") from error
            raise
    failures = {run.name: read_failure(batch.out, run.name) for run in batch.suite.runs}
    return {name: failure for name, failure in failures.items() if failure is not None}


def _as_it_is_now(batch: Batch) -> Batch:
    """The batch with the runs that another has made since it was prepared."""
    runs = batch.suite.runs
    if batch.finished == {run.name for run in runs if run_folder(batch.out, run.name).exists()}:
        return batch
    there = finished_runs(batch.out, runs, batch.inputs, batch.any_version)
    reusable = {name: path for name, path in batch.reusable.items() if name not in there}
    return replace(batch, finished=frozenset(there), reusable=reusable)


def _run_batch(batch: Batch, means: Means, watch: Watch | None) -> None:
    out = batch.out
    write_plan(out, Plan(suite=batch.suite, lacking=batch.lacking, command=means.command))
    clear_leftovers(out)
    try:
        batch = _with_reused(batch, means.decisions)
        for name in batch.finished:
            forget_failure(out, name)
        _run_missing(batch, means, watch)
    finally:
        clear_leftovers(out)
        write_table(out)


def _with_reused(batch: Batch, decisions: bool) -> Batch:
    """The batch with what other batches have made of it."""
    taken = {
        name for name, folder in batch.reusable.items() if take(folder, batch.out, name, decisions)
    }
    return replace(batch, finished=batch.finished | taken, reusable={})


def _run_missing(batch: Batch, means: Means, watch: Watch | None) -> None:
    missing = batch.missing
    if not missing:
        return
    tally = _Tally(batch, watch)
    with alive_file(batch.out) as alive, _engine(means, batch.out, len(missing)) as engine:
        tasks = [_task(batch, run, means.decisions, alive) for run in missing]
        tally.start(engine)
        for outcome in run_tasks(engine, tasks, means.care):
            tally.count(outcome, there=_keep(batch.out, outcome))


def _engine(means: Means, out: Path, runs: int) -> contextlib.AbstractContextManager[Engine]:
    if means.cluster is not None:
        return cluster_engine(means.cluster, out)
    return local_engine(min(means.workers, runs))


def _task(batch: Batch, run: RunSpec, decisions: bool, alive: Path) -> Task:
    folder, inputs = run_folder(batch.out, run.name).resolve(), batch.inputs.of(run)
    return Task(run.name, run.settings, folder, decisions, alive, versions(), inputs, Path.cwd())


def _keep(out: Path, outcome: Outcome) -> bool:
    """Write down a failure, or forget an earlier one; tells whether the run is there."""
    if is_whole(run_folder(out, outcome.name)):  # maybe its process ended just after it
        forget_failure(out, outcome.name)
        return True
    lost = Failure(
        kind="crash", error="the worker said that it was done, but the folder is not there"
    )
    write_failure(out, outcome.name, outcome.failure or lost)
    return False


class _Tally:
    """Counts what has ended, for who watches."""

    def __init__(self, batch: Batch, watch: Watch | None) -> None:
        self._wanted = len(batch.suite.runs)
        self._done = len(batch.finished)
        self._failed = 0
        self._last: Outcome | None = None
        self._watch = watch
        self._engine: Engine | None = None

    def start(self, engine: Engine) -> None:
        self._engine = engine
        self._tell()

    def count(self, outcome: Outcome, there: bool) -> None:
        self._last = outcome
        if there:
            self._done += 1
        else:
            self._failed += 1
        self._tell()

    def state(self) -> State:
        left = self._wanted - self._done - self._failed
        running = 0
        if self._engine is not None:
            running = self._engine.busy() or min(self._engine.places(), left)
        return State(self._done, self._failed, running, self._wanted, self._last)

    def _tell(self) -> None:
        if self._watch is not None:
            self._watch(self.state)
