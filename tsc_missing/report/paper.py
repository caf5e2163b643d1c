"""The paper's numbers beside ours, as ratios to a controller that both have.

The paper's travel times are ``att_approach`` on CityFlow, so its seconds are not ours. The common
controller is max-queue with everything observed, which was run on CityFlow with the same metric.
"""

import csv
import re
from dataclasses import dataclass
from functools import cache

from tsc_missing.batch.suite import PAPER, RunSpec
from tsc_missing.config import RunSettings
from tsc_missing.report.markdown import NOTHING, escaped, table
from tsc_missing.report.results import NOTHING_MISSING, Results
from tsc_missing.report.statistics import mean_of

METRIC = "att_approach"
COMMON = "max-queue"
COMMON_TABLE = "common-controller"
TIMES = "-time"  # tables of inference times end so
NAMES = {"RM": "random", "KM": "kriging"}
CONDITION = re.compile(
    r"(?P<pattern>RM|KM)\s*\((?P<rate>[\d.]+)%\)"
    r"(?P<adjacent> w/o neighbors)?(?: w/ neighbors)?(?: (?P<steps>\d+)-step)?"
)


@dataclass(frozen=True)
class Condition:
    """What a number of the paper is about, besides dataset and method."""

    pattern: str = "none"
    rate: float = 0.0
    adjacent: bool = False
    steps: int | None = None  # DDIM's, where the table says so


Key = tuple[str, str, Condition, str]  # table, dataset, condition, method


@cache
def paper_numbers() -> dict[Key, float]:
    """All numbers of the paper's tables, and the common controller's [s]."""
    with PAPER.open(encoding="utf-8", newline="") as stream:
        return {
            (row["table"], row["dataset"], parse_condition(row["condition"]), row["method"]): float(
                row["value_s"]
            )
            for row in csv.DictReader(stream)
        }


def parse_condition(text: str) -> Condition:
    """For example ``KM(25%) w/o neighbors`` or ``RM(50%) 10-step``; others are without holes."""
    found = CONDITION.fullmatch(text)
    if found is None:
        return Condition()
    return Condition(
        pattern=NAMES[found["pattern"]],
        rate=round(float(found["rate"]) / 100, 4),
        adjacent=found["adjacent"] is not None,
        steps=int(found["steps"]) if found["steps"] else None,
    )


def condition_of(spec: RunSpec, steps: bool) -> Condition:
    """The condition of a run; ``steps`` whether its sampling steps belong to it."""
    missing = spec.settings.missing
    return Condition(
        pattern=missing.pattern,
        rate=round(missing.rate, 4),
        adjacent=missing.adjacent,
        steps=spec.settings.diffusion.sampling_steps if steps else None,
    )


def find_number(tables: tuple[str, ...], dataset: str, spec: RunSpec) -> float | None:
    """What the first of the paper's ``tables`` that has it says of a run's method and case."""
    if spec.paper is None or not _is_comparable(spec.settings):
        return None
    numbers = paper_numbers()
    for name in tables:
        for steps in (False, True):
            key = (name, dataset, condition_of(spec, steps), spec.paper)
            if key in numbers:
                return numbers[key]
    return None


def _is_comparable(settings: RunSettings) -> bool:
    """Whether an hour is simulated, with the volume, sensors, counts and decisions of the paper.

    Those are the defaults here.
    """
    paper = RunSettings()
    return (
        (settings.horizon, settings.volume) == (paper.horizon, paper.volume)
        and settings.sensor == paper.sensor
        and settings.count_error == paper.count_error
        and settings.signals.decision_interval == paper.signals.decision_interval
    )


def paper_table(results: Results) -> list[str]:
    """A row a dataset, case and method that the paper has too: both ratios, and their quotient."""
    named = dict.fromkeys(t for plan in results.plans for t in plan.suite.paper)
    tables = tuple(name for name in named if not name.endswith(TIMES))
    rows = []
    for cell in results.ordered_cells:
        run = next(iter(results.by_cell[cell].values()))
        dataset = run.row["scenario"]
        theirs = find_number(tables, dataset, run.spec)
        base = paper_numbers().get((COMMON_TABLE, dataset, Condition(), COMMON))
        ours = mean_of(list(results.values(cell.dataset, cell.case, cell.method, METRIC).values()))
        common = _common(results, cell.dataset)
        if theirs is None or base is None or ours is None or common is None:
            continue
        one, other = theirs / base, ours.value / common
        words = [escaped(cell.dataset), escaped(cell.case), escaped(cell.method)]
        rows.append([*words, f"{one:.3f}", f"{other:.3f}", f"{other / one:.3f}"])
    if not rows:
        return []
    return table(
        ["dataset", "case", "method", "paper, ×", "ours, ×", "ours / paper"], rows, words=3
    )


def _common(results: Results, dataset: str) -> float | None:
    """Our ``att_approach`` of the common controller [s], of the method that is called so if any."""
    for method in sorted(results.methods, key=lambda name: name != COMMON):
        runs = results.of(dataset, NOTHING_MISSING, method)
        if runs and all(_is_common(run.spec.settings) for run in runs.values()):
            values = results.values(dataset, NOTHING_MISSING, method, METRIC)
            mean = mean_of(list(values.values()))
            return mean.value if mean is not None else None
    return None


def _is_common(settings: RunSettings) -> bool:
    """Whether it is the common controller as it is by default, which was run on CityFlow."""
    default = RunSettings()
    return settings.controller == COMMON and all(
        getattr(settings, name) == getattr(default, name)
        for name in ("signals", "sensor", "turning_counts", "count_error", "vehicle")
    )


def paper_time_table(results: Results) -> list[str]:
    """Decision times by sampling steps, as multiples of those of the fewest that the paper has."""
    tables = tuple(t for plan in results.plans for t in plan.suite.paper if t.endswith(TIMES))
    found: dict[tuple[str, str], dict[int, tuple[float | None, float]]] = {}
    for cell, runs in results.by_cell.items():
        run = next(iter(runs.values()))
        theirs = find_number(tables, run.row["scenario"], run.spec)
        values = results.values(cell.dataset, cell.case, cell.method, "decision_ms_median")
        ours = mean_of(list(values.values()))
        steps = run.spec.settings.diffusion.sampling_steps
        if ours is not None and tables and run.spec.paper is not None and steps is not None:
            found.setdefault((cell.dataset, cell.case), {})[steps] = (theirs, ours.value)
    rows = []
    for (dataset, case), by_steps in found.items():
        shared = [steps for steps, (theirs, _) in by_steps.items() if theirs is not None]
        first, least = by_steps[min(shared or by_steps)]
        for steps, (theirs, milliseconds) in sorted(by_steps.items()):
            paper = f"{theirs / first:.2f}" if theirs and first else NOTHING
            numbers = [str(steps), f"{milliseconds:.1f}", paper, f"{milliseconds / least:.2f}"]
            rows.append([escaped(dataset), escaped(case), *numbers])
    if not rows:
        return []
    header = ["dataset", "case", "steps", "decision, ms", "paper, ×", "ours, ×"]
    return table(header, rows, words=2)
