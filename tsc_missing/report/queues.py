"""Queues of run folders: over time, and by intersection and approach."""

from collections.abc import Sequence

import numpy as np
import pyarrow.parquet as pq
from matplotlib.figure import Figure

from tsc_missing.evaluation.run_folder import DECISIONS
from tsc_missing.network.model import FloatArray
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.report.conditions import sensor_words
from tsc_missing.report.leading import leading_methods, line_words
from tsc_missing.report.losses import costly_cases, listed_cases
from tsc_missing.report.results import Cell, Results, Run
from tsc_missing.report.style import add_legend, label, line_sample, looks, panels, scale_top

Line = tuple[FloatArray, FloatArray]  # times [s] and queues [vehicles]

MINUTE = 60.0  # [s]
SMOOTH = 300.0  # [s]
MOST_LISTED = 5  # outages of a list each that have panels
FEW = f"Of outages that were listed {MOST_LISTED} are shown, the costliest where that is known."
UNLIKE = (
    "Only vehicles within the sensors' reach are counted, so queues of panels with other sensors "
    "cannot be compared."
)


def read_queues(run: Run) -> tuple[FloatArray, FloatArray] | None:
    """Times (T,) [s] and true queues (T, N, 12) [vehicles]; None without decisions.parquet."""
    path = run.folder / DECISIONS
    if not path.is_file():
        return None
    table = pq.read_table(path, columns=["step", "time", "queue"])
    steps = int(table["step"][-1].as_py()) + 1
    queue = table["queue"].combine_chunks().flatten().to_numpy(zero_copy_only=False)
    time = table["time"].to_numpy().reshape(steps, -1)[:, 0]
    return time, queue.astype(np.float64).reshape(steps, -1, N_SLOTS)


def total_queue(runs: Sequence[Run]) -> tuple[FloatArray, FloatArray] | None:
    """Times (T,) [s] and the network's queue (T,) [vehicles], the mean over runs."""
    read = [found for run in runs if (found := read_queues(run)) is not None]
    if not read:
        return None
    steps = min(len(time) for time, _ in read)
    mean: FloatArray = np.mean([queue[:steps].sum(axis=(1, 2)) for _, queue in read], axis=0)
    return read[0][0][:steps], mean


def smooth(time: FloatArray, queue: FloatArray) -> FloatArray:
    """The mean of (T,) over the ``SMOOTH`` seconds around each time, shorter at both ends.

    In runs that are shorter than ten times that it is over a tenth of the run.
    """
    step = time[1] - time[0] if len(time) > 1 else 1.0
    half = int(min(SMOOTH, 0.1 * len(time) * step) / step / 2)
    sums = np.concatenate([[0.0], np.cumsum(queue)])
    place = np.arange(len(queue))
    first, last = np.maximum(0, place - half), np.minimum(len(queue), place + half + 1)
    mean: FloatArray = (sums[last] - sums[first]) / (last - first)
    return mean


def queue_figure(results: Results, metric: str) -> tuple[Figure, str] | None:
    """The network's queue over time, smoothed: a panel a dataset and case, a line a method.

    Of each pattern only the highest rate is shown, and of listed outages the costliest. With
    sentences about what is drawn.
    """
    cases = {dataset: _cases(results, dataset, metric) for dataset in results.datasets}
    few = any(left for _, left in cases.values())
    lines = {}
    for cell, runs in results.by_cell.items():
        if cell.case not in cases[cell.dataset][0]:
            continue
        found = total_queue(list(runs.values()))
        if found is not None:
            lines[cell] = (found[0], smooth(*found))
    there = (cell for cell in results.ordered_cells if cell in lines)
    wanted = list(dict.fromkeys((cell.dataset, cell.case) for cell in there))
    if not wanted:
        return None
    shown = [m for m in results.methods if any(cell.method == m for cell in lines)]
    leading = [m for m in leading_methods(results, metric) if m in shown]
    others = [m for m in shown if m not in leading]
    style = looks(results.methods, leading, results.references)
    samples = [line_sample(style[m], m) for m in leading]
    for sees_all, words in ((False, "the other methods"), (True, "SUMO's own programs")):
        alike = [m for m in others if (m in results.references) == sees_all]
        samples += [line_sample(style[m], words, marker=False) for m in alike[:1]]
    figure, axes = panels(len(wanted), len(samples), size=(3.2, 2.7))
    sensors = {place: _sensors(results, *place) for place in wanted}
    differ = len({*sensors.values()}) > 1
    tops = {
        dataset: scale_top(_peaks(lines, dataset, leading), _peaks(lines, dataset, others), low=0.0)
        for dataset, _ in wanted
    }
    for panel, (dataset, case) in zip(axes, wanted, strict=True):
        for cell, (time, queue) in lines.items():
            if (cell.dataset, cell.case) == (dataset, case):
                look = style[cell.method]
                grey = cell.method in others
                panel.plot(
                    time / MINUTE,
                    queue,
                    color=look.colour,
                    linestyle=look.line,
                    linewidth=0.8 if grey else 1.4,
                    marker="" if grey else look.marker,
                    markersize=4,
                    markevery=_marks(len(time), results.methods.index(cell.method)),
                    zorder=2 if grey else 3,
                )
        panel.set_ylim(0, tops[dataset])
        title = f"{dataset}, {_missing(case)}"
        title += f"\nsensor: {sensors[dataset, case]}" if differ else ""
        label(panel, title, "time, min", "queue, vehicles")
    add_legend(figure, samples)
    notes = line_words(results, metric, shown)
    notes += ["Grey lines may leave the scale."] if others else []
    notes += [UNLIKE] if differ else []
    notes += [FEW] if few else []
    return figure, " ".join(notes)


def _cases(results: Results, dataset: str, metric: str) -> tuple[list[str], bool]:
    """The cases that are shown, and whether listed outages are left out."""
    listed = listed_cases(results, dataset)
    costly = costly_cases(results, dataset, metric) or listed
    shown = {*costly[:MOST_LISTED]}
    cases = results.highest_cases(dataset)
    return [c for c in cases if c in shown or c not in listed], len(listed) > len(shown)


def _sensors(results: Results, dataset: str, case: str) -> str:
    """Those of the runs of a case."""
    cells = [cell for cell in results.by_cell if (cell.dataset, cell.case) == (dataset, case)]
    runs = [run for cell in cells for run in results.by_cell[cell].values()]
    return " and ".join(dict.fromkeys(map(sensor_words, runs)))


def _peaks(lines: dict[Cell, Line], dataset: str, methods: Sequence[str]) -> list[float]:
    """The largest queue of each line."""
    return [
        float(queue.max())
        for cell, (_, queue) in lines.items()
        if cell.dataset == dataset and cell.method in methods
    ]


def _marks(steps: int, number: int) -> tuple[int, int]:
    """The first step with a marker and how many lie between two; methods differ in the first."""
    apart = max(1, steps // 6)
    return (3 * number) % apart, apart


def _missing(case: str) -> str:
    return "everything observed" if case == "none" else case
