"""The tables that ``tsc-compare`` prints."""

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from tsc_missing.report.compare import Change, Comparison, FinishedRun, difference
from tsc_missing.report.markdown import NOTHING
from tsc_missing.report.places import Place
from tsc_missing.words import counted

ARROW = "→"
WIDTH = 1000  # characters: a line that a terminal breaks is better than a name that is cut
FIELDS = {  # result fields with decimals and what they are; the others are in the JSON object
    "att_all": (1, "s, travel time, mean over all demand"),
    "p95_travel_time": (1, "s, of it"),
    "att_approach": (1, "s, on approaches"),
    "att_finished": (1, "s, finished trips"),
    "time_loss": (1, "s, mean over inserted vehicles"),
    "depart_delay": (1, "s, waiting to enter, mean over all demand"),
    "demand": (0, "vehicles"),
    "finished": (0, "vehicles"),
    "never_inserted": (0, "vehicles that never entered"),
    "mean_queue": (1, "vehicles below 0.1 m/s"),
    "teleports": (0, ""),
    "collisions": (0, ""),
    "emergency_brakings": (0, ""),
    "gridlock": (0, "at the end"),
    "missing_share": (3, "of movement readings"),
    "imputation_mae": (2, "vehicles, imputation error"),
    "fallbacks": (0, "decisions by the safe fallback"),
    "held_greens": (0, "changes that waited for the minimum green"),
}


def print_comparison(comparison: Comparison, rows: int, written: Sequence[Path]) -> None:
    """Print runs, results, settings and so many places (0: all), to standard output."""
    console = Console(highlight=False, soft_wrap=True, width=WIDTH)
    for number, run in enumerate(comparison.runs, start=1):
        console.print(f"{number}  {run.folder}  ({_heading(run)})", markup=False)
    console.print()
    console.print(_results(comparison))
    if comparison.differing:
        console.print("\nwhat differs in run.json", markup=False)
        console.print(_settings(comparison))
    count = rows or len(comparison.changes)
    chosen = comparison.most_changed(count)
    console.print(f"\n{_title(comparison, len(chosen))}", markup=False)
    console.print(_places(comparison, chosen))
    for warning in comparison.warnings:
        console.print(f"warning: {warning}", style="yellow", markup=False)
    if written:
        console.print(f"\nwritten to {' and '.join(map(str, written))}", markup=False)


def _heading(run: FinishedRun) -> str:
    return f"{run.file.scenario}, {run.file.demand} demand, {run.file.settings.controller}"


def _title(comparison: Comparison, shown: int) -> str:
    every = counted(len(comparison.changes), comparison.each)
    which = f"{shown} of {every}" if shown < len(comparison.changes) else every
    kind = " whose delay changed most" if len(comparison.runs) > 1 else ""
    return (
        f"{which}{kind}, the worst first\n"
        "(delay: seconds a vehicle, waiting to enter included, and level of service)"
    )


def _results(comparison: Comparison) -> Table:
    table = Table(box=None, pad_edge=False, show_header=len(comparison.runs) > 1, header_style="")
    table.add_column(style="bold")
    for number in range(1, len(comparison.runs) + 1):
        table.add_column(str(number), justify="right")
        if number > 1:
            table.add_column(f"{number} − 1", justify="right")
            table.add_column("", justify="right")
    table.add_column(style="dim")
    for name, (digits, meaning) in FIELDS.items():
        values = [run.file.result.get(name) for run in comparison.runs]
        if any(values):
            table.add_row(name, *_result_cells(values, digits), meaning)
    return table


def _result_cells(values: Sequence[object], digits: int) -> list[str]:
    cells = [number_words(values[0], digits)]
    for value in values[1:]:
        more, percent = difference(values[0], value)
        share = f"{signed_words(percent, 1)} %" if more and percent is not None else ""
        cells += [number_words(value, digits), signed_words(more or None, digits), share]
    return cells


def number_words(value: object, digits: int) -> str:
    """A number with so many decimals; truth values as yes and no, a dash for None."""
    if value is None:
        return NOTHING
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.{digits}f}"


def signed_words(value: float | None, digits: int) -> str:
    """With a sign that is as wide as a digit; nothing for None."""
    if value is None:
        return ""
    rounded = round(value, digits) + 0.0
    return f"{'−' if rounded < 0 else '+'}{abs(rounded):.{digits}f}"


def _settings(comparison: Comparison) -> Table:
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="bold")
    table.add_column()
    for name, values in comparison.differing.items():
        words = [NOTHING if value in (None, "", []) else str(value) for value in values]
        table.add_row(name, f" {ARROW} ".join(words))
    return table


def _places(comparison: Comparison, rows: Sequence[Change]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="")
    table.add_column(comparison.each)
    for name in ("observed", "served"):
        table.add_column(name, justify="right")
    for number in range(1, len(comparison.runs) + 1):
        several = len(comparison.runs) > 1
        table.add_column(f"delay in {number}" if several else "delay", justify="right")
        if number > 1:
            table.add_column(f"{number} − 1", justify="right")
    if len(comparison.runs) == 1:
        for name in ("mean queue", "longest", "longest wait"):
            table.add_column(name, justify="right")
    for row in rows:
        table.add_row(*_cells(row))
    return table


def _cells(row: Change) -> list[str]:
    first = row.places[0]
    cells = [
        first.name,
        _joined([f"{100 * place.observed:.0f}" for place in row.places]) + " %",
        _joined([f"{place.served:.0f}" for place in row.places]),
        _delay(first),
    ]
    for place, more in zip(row.places[1:], row.delays, strict=True):
        cells += [_delay(place), signed_words(more, 1) or NOTHING]
    if len(row.places) == 1:
        wait = NOTHING if first.longest_wait is None else f"{first.longest_wait:.0f} s"
        cells += [f"{first.mean_queue:.1f}", f"{first.longest_queue:.0f}", wait]
    return cells


def _joined(words: Sequence[str]) -> str:
    """Once, where it is the same in all runs."""
    return words[0] if len({*words}) == 1 else f" {ARROW} ".join(words)


def _delay(place: Place) -> str:
    return f"{number_words(place.delay, 1)} {place.level_of_service or NOTHING}"
