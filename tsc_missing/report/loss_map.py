"""A map of what the loss of each intersection's sensors costs, from lists of outages."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tsc_missing.batch.suite import slug
from tsc_missing.evaluation.run_folder import MASK
from tsc_missing.network.coverage import Coverage
from tsc_missing.network.folder import NetworkFolder
from tsc_missing.network.model import FloatArray, Network
from tsc_missing.network.picture import DPI, MARGIN, choose_layout, map_axes
from tsc_missing.network.picture_legend import (
    add_colour_bar,
    add_legend,
    add_scale_bar,
    add_title,
    nothing_with,
)
from tsc_missing.network.picture_marks import draw_roads, road_band
from tsc_missing.network.picture_names import draw_names
from tsc_missing.network.picture_style import INK, WHITE, choose_sizes
from tsc_missing.network.roads import read_roads
from tsc_missing.report.losses import cost_of, listed_cases, map_labels
from tsc_missing.report.markdown import signed
from tsc_missing.report.results import Results, Run
from tsc_missing.report.scenes import network_folder
from tsc_missing.sensing.masks import load_mask

COSTS = "YlOrRd"
BAR = 2.3  # [inches]
FINE = 0.05  # share of the whole, below which the bar has decimals
FEWEST = 3  # intersections, for less a table says it better


@dataclass(frozen=True)
class Losses:
    """What the loss of single intersections' sensors cost a method on a dataset."""

    folder: NetworkFolder
    run: Run  # one of them
    costs: FloatArray  # (N,): by how much worse each makes it, NaN where none was tried
    cases: tuple[str, ...]  # (N,): of each intersection, empty where none was tried


def loss_maps(results: Results, metric: str) -> Iterator[tuple[str, Figure, str]]:
    """Name, picture and words for each dataset and method that lost single intersections."""
    for dataset in results.datasets:
        for method in results.methods:
            losses = find_losses(results, dataset, method, metric)
            if losses is not None:
                words = (
                    f"What it costs {method} on {dataset} when an intersection's sensors are "
                    f"silent for the whole run: {metric} beside that with nothing missing, "
                    "paired by seed, mean over seeds."
                )
                figure = _draw(losses, metric, map_labels(results, dataset, metric))
                yield slug(f"losses-{dataset}-{method}"), figure, words


def find_losses(results: Results, dataset: str, method: str, metric: str) -> Losses | None:
    """None where too few intersections were tried, or the network is gone."""
    found = {
        case: (next(iter(runs.values())), ratio.value - 1)
        for case in listed_cases(results, dataset)
        if (runs := results.of(dataset, case, method))
        and (ratio := cost_of(results, dataset, case, method, metric))
    }
    if len(found) < FEWEST:
        return None
    run, _ = next(iter(found.values()))
    folder = network_folder(run)
    if folder is None:
        return None
    network = folder.network
    costs, cases = np.full(network.n, np.nan), [""] * network.n
    for case, (one, cost) in found.items():
        lost = _lost(one, network)
        if lost is not None:
            costs[lost], cases[lost] = cost, case
    enough = np.isfinite(costs).sum() >= FEWEST
    return Losses(folder, run, costs, tuple(cases)) if enough else None


def _lost(run: Run, network: Network) -> int | None:
    """The intersection that is blind in a run, where all others report always."""
    path = run.folder / MASK
    if not path.is_file():
        return None
    coverage = Coverage.of_mask(load_mask(path, network), network.slot_mask)
    alone = coverage.blind.sum() == 1 and not coverage.partly.any()
    return int(coverage.blind.argmax()) if alone else None


def _draw(losses: Losses, metric: str, names: dict[str, str]) -> Figure:
    """The map; ``names`` is how it calls each case."""
    network, run, costs = losses.folder.network, losses.run, losses.costs
    roads = read_roads(losses.folder.net_file, network.record)
    sizes = choose_sizes(network, roads)
    tried = np.isfinite(costs)
    top = max(0.01, float(costs[tried].max()))
    norm = Normalize(min(0.0, float(costs[tried].min())), top)
    numbered = any(names[case] != case for case in losses.cases if case)
    dot: dict[str, Any] = {"ls": "", "marker": "o", "mec": INK, "mew": 0.9, "ms": 10}
    entries = [
        (Line2D([], [], mfc="#fd8d3c", **dot), "its sensors silent, others not"),
        *([] if tried.all() else [(Line2D([], [], mfc=WHITE, **dot), "not tried")]),
        *([nothing_with("numbers: rows of the table")] if numbered else []),
    ]
    caption = f"{run.spec.method}: {metric} when an intersection loses its sensors"
    layout = choose_layout(sizes, len(entries) + 1, colours=True, caption=caption)
    figure = Figure(figsize=layout.figure, dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    axes = map_axes(figure, layout, sizes)
    draw_roads(axes, roads, sizes)
    x, y = network.coordinates.T
    area = (1.5 * sizes.radius * layout.points) ** 2
    style: dict[str, Any] = {"edgecolors": INK, "linewidths": 0.9, "zorder": 3}
    axes.scatter(x[~tried], y[~tried], s=area[~tried], c=WHITE, **style)
    axes.scatter(x[tried], y[tried], s=area[tried], c=costs[tried], cmap=COSTS, norm=norm, **style)
    labels = [
        f"{names[case]}\n{signed(100 * cost)} %"
        for case, cost in zip(losses.cases, costs, strict=True)
        if case
    ]
    bands = [road_band(road, sizes) for road in roads]
    places, radius = network.coordinates[tried], sizes.radius[tried]
    note = draw_names(figure, axes, labels, places, radius, bands)
    entries += [nothing_with(note)] if note else []
    add_title(figure, layout.title, layout.figure[0] - 2 * MARGIN, run.spec.dataset, caption)
    add_legend(figure, layout.legend, entries)
    words, decimals = "above that with nothing missing", int(top < FINE)
    add_colour_bar(figure, layout.colours, BAR, norm, words, COSTS, decimals=decimals)
    add_scale_bar(figure, layout.metres, layout.scale, 1.7)
    return figure
