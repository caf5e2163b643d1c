"""The results that a report is about: the runs of one or several batches."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from tsc_missing.batch.folder import Plan, read_plan, run_folder
from tsc_missing.batch.suite import RunSpec
from tsc_missing.batch.table import FINISHED, Row, read_rows
from tsc_missing.controllers.catalogue import FULL_INFORMATION
from tsc_missing.controllers.resolved import code_of, uses_weights
from tsc_missing.errors import UserError
from tsc_missing.report.comparable import FIELD, check_comparable

NOTHING_MISSING = "none"  # the case

Kind = Literal["reference", "conventional", "learned", "own"]


@dataclass(frozen=True)
class Run:
    """A run: what was wanted, its row of the table, and its folder."""

    spec: RunSpec
    row: Row
    folder: Path

    @property
    def kind(self) -> Kind:
        """``reference``: run by SUMO itself, which sees everything, whatever is missing."""
        if self.spec.settings.controller in FULL_INFORMATION:
            return "reference"
        if code_of(self.spec.settings):
            return "own"
        return "learned" if uses_weights(self.spec.settings) else "conventional"


@dataclass(frozen=True)
class Cell:
    """The place of a number in a table."""

    dataset: str
    case: str
    method: str


class Results:
    """The runs of batches, by dataset, case and method in the order of their suites."""

    def __init__(self, plans: Sequence[Plan], runs: Iterable[Run]) -> None:
        """``runs`` are those of the plans."""
        self.plans = tuple(plans)
        self.runs = tuple(runs)
        self.finished = tuple(run for run in self.runs if run.row["status"] == FINISHED)

    @cached_property
    def by_cell(self) -> dict[Cell, dict[int, Run]]:
        """The finished runs of each cell by seed."""
        found: dict[Cell, dict[int, Run]] = {}
        for run in self.finished:
            cell = Cell(run.spec.dataset, run.spec.case, run.spec.method)
            found.setdefault(cell, {})[run.spec.settings.seed] = run
        return found

    @property
    def ordered_cells(self) -> list[Cell]:
        """Those of ``by_cell`` by dataset, case and method."""
        cells = (
            Cell(dataset, case, method)
            for dataset in self.datasets
            for case in self.cases(dataset)
            for method in self.methods
        )
        return [cell for cell in cells if cell in self.by_cell]

    @cached_property
    def datasets(self) -> tuple[str, ...]:
        """In the order of the suites."""
        return tuple(dict.fromkeys(run.spec.dataset for run in self.finished))

    def cases(self, dataset: str) -> tuple[str, ...]:
        """Of a dataset: nothing missing, then patterns as in the suites, each by its rates."""
        return self._ordered([run for run in self.finished if run.spec.dataset == dataset])

    def highest_cases(self, dataset: str) -> tuple[str, ...]:
        """Of ``cases`` those at the highest rate of their pattern; all that have no rate."""
        runs = [run for run in self.finished if run.spec.dataset == dataset]
        highest: dict[tuple[object, ...], float] = {}
        for run in runs:
            rate = run.spec.settings.missing.rate
            highest[_pattern(run)] = max(rate, highest.get(_pattern(run), 0.0))
        found = [run for run in runs if run.spec.settings.missing.rate == highest[_pattern(run)]]
        return self._ordered(found)

    def _ordered(self, runs: Sequence[Run]) -> tuple[str, ...]:
        """Their cases: nothing missing, then patterns as in the suites, each by its rates."""
        patterns = list(dict.fromkeys(map(_pattern, runs)))

        def place(run: Run) -> tuple[bool, int, float]:
            some = run.spec.case != NOTHING_MISSING
            return some, patterns.index(_pattern(run)), run.spec.settings.missing.rate

        return tuple(dict.fromkeys(run.spec.case for run in sorted(runs, key=place)))

    @cached_property
    def methods(self) -> tuple[str, ...]:
        """In the order of the suites; weights by the case that they were trained on."""
        trained = {run.spec.method: run.spec.trained for run in self.finished}
        if None in trained.values():
            return tuple(trained)
        cases = list(self._ordered(self.finished))
        place = {name: cases.index(case) if case in cases else -1 for name, case in trained.items()}
        return tuple(sorted(trained, key=lambda name: place[name]))

    @cached_property
    def kinds(self) -> dict[str, Kind]:
        """What each method is."""
        return {run.spec.method: run.kind for run in self.finished}

    @property
    def references(self) -> tuple[str, ...]:
        """Of ``methods`` those that see everything."""
        return tuple(method for method in self.methods if self.kinds[method] == "reference")

    def of(self, dataset: str, case: str, method: str) -> dict[int, Run]:
        """The runs of a cell by seed; empty where there are none."""
        return self.by_cell.get(Cell(dataset, case, method), {})

    def values(self, dataset: str, case: str, method: str, metric: str) -> dict[int, float]:
        """A result field of a cell's runs by seed, where it is not null."""
        runs = self.of(dataset, case, method)
        values = {seed: run.row[metric] for seed, run in runs.items()}
        return {seed: float(value) for seed, value in values.items() if value is not None}

    def versions(self) -> dict[str, list[str]]:
        """All versions that made the results."""
        found: dict[str, dict[str, None]] = {}
        for text in dict.fromkeys(run.row["versions"] for run in self.finished):
            for name, version in json.loads(text or "{}").items():
                found.setdefault(name, {})[version] = None
        return {name: list(all_) for name, all_ in found.items()}


def _pattern(run: Run) -> tuple[object, ...]:
    """What is missing in a run, whatever the rate."""
    return tuple(run.spec.settings.missing.model_dump(exclude={"rate"}).values())


def read_results(folders: Sequence[Path]) -> Results:
    """The results of batches, read from their run folders.

    ``UserError`` for what is no batch's folder, has no finished run, or where two of them have a
    run of one dataset, case, method and seed, or where runs that are compared or averaged cannot
    be (``check_comparable``).
    """
    plans, runs = [], []
    for folder in folders:
        plan = read_plan(folder, FIELD)
        plans.append(plan)
        for spec, row in zip(plan.suite.runs, read_rows(folder, FIELD), strict=True):
            runs.append(Run(spec, row, run_folder(folder, spec.name)))
    results = Results(plans, runs)
    if not results.finished:
        raise UserError(FIELD, folders[0], "no run in it is finished")
    _check_one_of_each(results)
    check_comparable(results.finished)
    return results


def _check_one_of_each(results: Results) -> None:
    seen: dict[Any, Path] = {}
    for run in results.finished:
        key = (run.spec.dataset, run.spec.case, run.spec.method, run.spec.settings.seed)
        if key in seen:
            raise UserError(
                FIELD, run.folder, f"{seen[key]} is a run of the same method, case and seed"
            )
        seen[key] = run.folder
