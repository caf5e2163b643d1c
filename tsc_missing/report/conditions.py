"""Under which conditions methods and cases ran, where they are not the same."""

import json
from collections.abc import Iterator

from tsc_missing.batch.keys import dotted, leaves
from tsc_missing.batch.suite import METHOD_GROUPS, METHOD_KEYS, RunSpec
from tsc_missing.report.results import Results, Run

OF_METHODS = {*METHOD_GROUPS} - {"controller"}  # which is the method itself
TIMING = ("decision_interval", "yellow", "all_red", "min_green", "network_timing")

Ran = dict[str, dict[str, list[str]]]  # the methods by case and by what they ran with


def unlike_methods(results: Results) -> list[str]:
    """For each dataset and condition in which methods of a case differ what they ran with."""
    found = []
    for dataset, name, ran in _conditions(results):
        cases: dict[str, list[str]] = {}
        for case, methods in ran.items():
            if len(methods) > 1:
                cases.setdefault(_by_value(methods), []).append(case)
        for words, where in cases.items():
            only = "" if len(where) == len(ran) else f" ({', '.join(where)})"
            found.append(f"{dataset}{only}, {name} {words}")
    return found


def unlike_cases(results: Results) -> list[str]:
    """For each dataset and condition in which cases differ, but no methods of one, the same."""
    found = []
    for dataset, name, ran in _conditions(results):
        cases: dict[str, list[str]] = {}
        for case, methods in ran.items():
            if len(methods) == 1:
                (value,) = methods
                cases.setdefault(value, []).append(case)
        if len(cases) > 1:
            found.append(f"{dataset}, {name} {_by_value(cases)}")
    return found


def mixed_sources(results: Results, most: int = 3) -> str | None:
    """Which cells are means over runs of several revisions of the source; None without any."""
    cells = [
        f"{cell.dataset}: {cell.case}: {cell.method}"
        for cell in results.ordered_cells
        if len({_source(run) for run in results.by_cell[cell].values()} - {None}) > 1
    ]
    if not cells:
        return None
    more = f"; and {len(cells) - most} more" if len(cells) > most else ""
    words = "cell is a mean" if len(cells) == 1 else "cells are means"
    named = "; ".join(cells[:most])
    return f"{len(cells)} {words} over runs of more than one source revision ({named}{more})."


def _source(run: Run) -> str | None:
    found: str | None = json.loads(run.row["versions"] or "{}").get("source")
    return found


def sensor_words(run: Run) -> str:
    """The sensors of a run, for example ``area of 50 m``."""
    sensor = run.spec.settings.sensor
    return f"area of {sensor.length:g} m" if sensor.kind == "area" else sensor.kind


def _conditions(results: Results) -> Iterator[tuple[str, str, Ran]]:
    """Each dataset and condition, the latter by its setting's name, with what ran."""
    for dataset in results.datasets:
        found: dict[str, Ran] = {}
        for cell in results.ordered_cells:
            if cell.dataset != dataset:
                continue
            runs = results.by_cell[cell]
            for name, value in dict.fromkeys(p for run in runs.values() for p in _of_run(run)):
                methods = found.setdefault(name, {}).setdefault(cell.case, {})
                methods.setdefault(value, []).append(cell.method)
        for name, ran in found.items():
            yield dataset, name, ran


def _of_run(run: Run) -> list[tuple[str, str]]:
    """The timing of the signals, the sensors, and what of a method neither it nor a label says."""
    signals = run.spec.settings.signals
    timing = [(f"signals.{name}", str(getattr(signals, name))) for name in TIMING]
    return [*timing, ("sensor", sensor_words(run)), *_unsaid(run.spec)]


def _unsaid(spec: RunSpec) -> Iterator[tuple[str, str]]:
    """Settings of the kind that make methods, where neither its definition nor its label does."""
    axes = {words.rpartition(" ")[0] for words in spec.method.split(", ")}
    for key, value in leaves(spec.settings.model_dump(mode="json")):
        if key not in METHOD_KEYS and key[0] not in OF_METHODS:
            continue
        if key[-1] not in axes and not _is_defined(spec, dotted(key)):
            yield dotted(key), str(value)


def _is_defined(spec: RunSpec, key: str) -> bool:
    """Whether the method's definition sets it; of old plans, whether there may be a definition."""
    if spec.defined is None:
        return spec.method != spec.settings.controller
    return key in spec.defined


def _by_value(names: dict[str, list[str]]) -> str:
    return "; ".join(f"{value}: {', '.join(all_)}" for value, all_ in names.items())
