"""Under which conditions methods and cases ran, where they are not the same."""

from collections.abc import Iterator

from tsc_missing.report.results import Results, Run

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
    """The timing of the signals and the sensors."""
    signals = run.spec.settings.signals
    timing = [(f"signals.{name}", str(getattr(signals, name))) for name in TIMING]
    return [*timing, ("sensor", sensor_words(run))]


def _by_value(names: dict[str, list[str]]) -> str:
    return "; ".join(f"{value}: {', '.join(all_)}" for value, all_ in names.items())
