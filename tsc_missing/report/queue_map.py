"""A map of a run: roads coloured by their mean queue, missing sensors marked."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tsc_missing.evaluation.run_folder import MASK
from tsc_missing.network.coverage import Coverage
from tsc_missing.network.model import BoolArray, FloatArray, Network
from tsc_missing.network.picture import DPI, MARGIN, choose_layout, map_axes
from tsc_missing.network.picture_legend import (
    add_colour_bar,
    add_legend,
    add_scale_bar,
    add_title,
)
from tsc_missing.network.picture_marks import draw_roads, road_band
from tsc_missing.network.picture_style import INK, NEVER, ROAD, WHITE, Sizes, choose_sizes
from tsc_missing.network.roads import Road, read_roads
from tsc_missing.network.slots import TURNS
from tsc_missing.report.queues import read_queues
from tsc_missing.report.results import Results, Run
from tsc_missing.report.scenes import network_folder
from tsc_missing.report.statistics import mean_of
from tsc_missing.sensing.masks import load_mask

QUEUES = "YlGnBu"
PARTLY = "#9aa5b1"
BAR = 2.3  # [inches]


def map_runs(results: Results, metric: str) -> list[Run]:
    """For each dataset the run to draw: of the case that misses most whole intersections.

    Of the methods that do not see everything the one with the smallest mean, its first seed.
    """
    found = []
    for dataset in results.datasets:
        runs = [
            run
            for run in results.finished
            if run.spec.dataset == dataset and run.kind != "reference"
        ]
        if not runs:
            continue
        case = max(runs, key=_blindness).spec.case
        means = {
            method: mean.value
            for method in dict.fromkeys(run.spec.method for run in runs)
            if (mean := mean_of(list(results.values(dataset, case, method, metric).values())))
        }
        if means:
            seeds = results.of(dataset, case, min(means, key=lambda method: means[method]))
            found.append(seeds[min(seeds)])
    return found


def _blindness(run: Run) -> tuple[bool, bool, float]:
    missing = run.spec.settings.missing
    return missing.pattern == "kriging", bool(missing.file), missing.rate


def queue_map(run: Run) -> Figure | None:
    """The picture of a run; None where it wrote no decisions, or its network is gone."""
    read, folder = read_queues(run), network_folder(run)
    if read is None or folder is None:
        return None
    network = folder.network
    mask_file = run.folder / MASK
    mask = load_mask(mask_file, network) if mask_file.is_file() else None
    coverage = Coverage.of_mask(
        mask if mask is not None else np.ones((1, *network.slot_mask.shape), dtype=bool),
        network.slot_mask,
    )
    roads = read_roads(folder.net_file, network.record)
    return _draw(run, network, roads, coverage, read[1].mean(axis=0))


def road_queues(network: Network, queue: FloatArray) -> dict[str, float]:
    """The queue [vehicles] of each road that leads to a signal, from (N, 12) by slots."""
    approaches = queue.reshape(network.n, -1, len(TURNS)).sum(axis=2)  # (N, 4)
    return {
        road: float(approaches[n, approach])
        for n, node in enumerate(network.intersections)
        for road, approach in node.roads.items()
    }


def _draw(
    run: Run, network: Network, roads: tuple[Road, ...], coverage: Coverage, queue: FloatArray
) -> Figure:
    sizes = choose_sizes(network, roads)
    queues = road_queues(network, queue)
    colours = Normalize(0.0, max(1.0, *queues.values()))
    entries = _legend(coverage, network.n)
    caption = (
        f"{run.spec.method}, {run.spec.case} missing, seed {run.spec.settings.seed}: mean queue "
        f"{run.row['mean_queue']:.0f}\u00a0vehicles, att_all\u00a0{run.row['att_all']:.0f}\u00a0s"
    )
    layout = choose_layout(sizes, len(entries), colours=True, caption=caption)
    figure = Figure(figsize=layout.figure, dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    axes = map_axes(figure, layout, sizes)
    draw_roads(axes, roads, sizes)
    _colour_roads(axes, roads, sizes, queues, colours)
    _mark_intersections(axes, network, sizes, layout.points, coverage)
    add_title(figure, layout.title, layout.figure[0] - 2 * MARGIN, run.spec.dataset, caption)
    add_legend(figure, layout.legend, entries)
    words = "mean queue of a road, vehicles"
    add_colour_bar(figure, layout.colours, BAR, colours, words, QUEUES, percent=False)
    add_scale_bar(figure, layout.metres, layout.scale, 1.7)
    return figure


def _colour_roads(
    axes: Axes, roads: tuple[Road, ...], sizes: Sizes, queues: dict[str, float], norm: Normalize
) -> None:
    chosen = [road for road in roads if road.id in queues]
    bands = PolyCollection(
        [road_band(road, sizes) for road in chosen],
        array=np.array([queues[road.id] for road in chosen]),
        cmap=QUEUES,
        norm=norm,
        edgecolor=INK,
        linewidth=0.3,
        zorder=2,
        gid="queues",
    )
    axes.add_collection(bands, autolim=False)


def _mark_intersections(
    axes: Axes, network: Network, sizes: Sizes, scale: float, coverage: Coverage
) -> None:
    area = (1.5 * sizes.radius * scale) ** 2
    outline: dict[str, Any] = {"edgecolors": INK, "linewidths": 0.9}

    def mark(which: BoolArray, gid: str, shape: str, grow: float = 1.0, **style: Any) -> None:
        if which.any():
            x, y = network.coordinates[which].T
            axes.scatter(x, y, s=area[which] * grow**2, marker=shape, gid=gid, zorder=3, **style)

    mark(~coverage.blind & ~coverage.partly, "always-observed", "o", c=WHITE, **outline)
    mark(coverage.partly, "partly-observed", "o", c=PARTLY, **outline)
    mark(coverage.blind, "never-observed", "s", 1.15, c=NEVER, **outline)
    mark(coverage.blind, "never-observed-crosses", "x", 0.7, c=WHITE, linewidths=1.8)


def _legend(coverage: Coverage, n: int) -> list[tuple[Any, str]]:
    partly, blind = int(coverage.partly.sum()), int(coverage.blind.sum())
    dot: dict[str, Any] = {"ls": "", "mec": INK, "mew": 0.9, "ms": 10}
    entries: list[tuple[Any, str]] = [(Patch(facecolor=ROAD), "road that is not counted")]
    if n - partly - blind:
        entries.append((Line2D([], [], marker="o", mfc=WHITE, **dot), "always observed"))
    if partly:
        entries.append((Line2D([], [], marker="o", mfc=PARTLY, **dot), "partly observed"))
    if blind:
        cross = Line2D([], [], ls="", marker="x", ms=6, mew=1.6, color=WHITE)
        square = Line2D([], [], marker="s", mfc=NEVER, **dot)
        entries.append(((square, cross), f"never observed ({blind})"))
    return entries
