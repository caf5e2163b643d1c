"""A map of a run: intersections coloured by their delay, or by its change between two runs."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from tsc_missing.errors import UserError
from tsc_missing.network.folder import NET
from tsc_missing.network.model import BoolArray, FloatArray, Network
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
from tsc_missing.network.picture_style import INK, WHITE, Sizes, choose_sizes
from tsc_missing.network.roads import read_roads
from tsc_missing.report.compare import Comparison
from tsc_missing.report.markdown import signed
from tsc_missing.report.scenes import unchanged_folder

DELAYS = "YlOrRd"
CHANGES = "PuOr_r"  # from less delay to more; told apart by all kinds of sight
BAR = 2.3  # [inches]
LEAST = 10.0  # [s], at the end of the scale of delays
LEAST_CHANGE = 1.0  # [s]
OUTLINED = [withStroke(linewidth=3.6, foreground=WHITE)]


@dataclass(frozen=True)
class Shown:
    """What the map shows of N intersections, and in which words and colours."""

    values: FloatArray  # (N,) [s a vehicle], NaN where nobody came
    labels: list[str]  # (N,)
    blind: BoolArray  # (N,): never observed, in one run at least
    norm: Normalize
    colours: str
    words: str  # of the colour bar
    caption: str


def delay_map(comparison: Comparison, field: str) -> Figure:
    """The picture of one run or two, by intersections; ``UserError`` where the network is gone."""
    run = comparison.runs[0]
    settings, was = run.file.settings, run.file.checksums.get(NET)
    folder = unchanged_folder(settings.net, settings.demand, was)
    if folder is None:
        words = f"that network of {run.folder} is not there, or another by now"
        raise UserError(field, settings.net, words, verdict="cannot be drawn")
    network = folder.network
    return _draw(network, folder.net_file, _shown(comparison, network), run.file.scenario)


def _shown(comparison: Comparison, network: Network) -> Shown:
    change_of = {change.places[0].intersection: change for change in comparison.changes}
    changes = [change_of[name] for name in network.ids]
    last = [change.places[-1] for change in changes]
    blind = np.array([any(place.observed == 0 for place in it.places) for it in changes])
    names = " → ".join(run.folder.resolve().name for run in comparison.runs)
    if len(comparison.runs) == 1:
        delays = np.array([place.delay for place in last], dtype=float)
        top = float(np.nanmax(delays, initial=LEAST))
        labels = [f"{p.intersection}\n{p.delay or 0:.0f} s {p.level_of_service}" for p in last]
        norm, words = Normalize(0.0, top), "delay, seconds a vehicle"
        caption = f"{names}: delay at intersections, waiting to enter included"
        return Shown(delays, labels, blind, norm, DELAYS, words, caption)
    more = np.array([change.delays[0] for change in changes], dtype=float)
    top = float(np.nanmax(np.abs(more), initial=LEAST_CHANGE))
    labels = [f"{name}\n{signed(it)} s" for name, it in zip(network.ids, more, strict=True)]
    words = "change of delay, seconds a vehicle"
    caption = f"{names}: by how much the delay at intersections changed"
    return Shown(more, labels, blind, Normalize(-top, top), CHANGES, words, caption)


def _draw(network: Network, net_file: Any, shown: Shown, title: str) -> Figure:
    roads = read_roads(net_file, network.record)
    sizes = choose_sizes(network, roads)
    entries = _legend(shown)
    layout = choose_layout(sizes, len(entries) + 1, colours=True, caption=shown.caption)
    figure = Figure(figsize=layout.figure, dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    axes = map_axes(figure, layout, sizes)
    draw_roads(axes, roads, sizes)
    _mark_intersections(axes, network, sizes, layout.points, shown)
    known = np.isfinite(shown.values)
    labels = [label for label, is_known in zip(shown.labels, known, strict=True) if is_known]
    bands = [road_band(road, sizes) for road in roads]
    if labels:
        places, radius = network.coordinates[known], sizes.radius[known]
        note = draw_names(figure, axes, labels, places, radius, bands)
        entries += [nothing_with(note)] if note else []
    add_title(figure, layout.title, layout.figure[0] - 2 * MARGIN, title, shown.caption)
    add_legend(figure, layout.legend, entries)
    add_colour_bar(
        figure, layout.colours, BAR, shown.norm, shown.words, shown.colours, percent=False
    )
    add_scale_bar(figure, layout.metres, layout.scale, 1.7)
    return figure


def _mark_intersections(
    axes: Axes, network: Network, sizes: Sizes, scale: float, shown: Shown
) -> None:
    area = (1.5 * sizes.radius * scale) ** 2
    known = np.isfinite(shown.values)
    colours: Any = colormaps[shown.colours](shown.norm(np.nan_to_num(shown.values)))
    colours[~known] = (1.0, 1.0, 1.0, 1.0)

    def mark(which: BoolArray, gid: str, shape: str, grow: float = 1.0, **style: Any) -> None:
        if which.any():
            x, y = network.coordinates[which].T
            axes.scatter(x, y, s=area[which] * grow**2, marker=shape, gid=gid, zorder=3, **style)

    outline: dict[str, Any] = {"edgecolors": INK, "linewidths": 0.9}
    mark(~shown.blind, "observed", "o", c=colours[~shown.blind], **outline)
    mark(shown.blind, "never-observed", "s", 1.15, c=colours[shown.blind], **outline)
    cross: dict[str, Any] = {"c": INK, "linewidths": 1.6, "path_effects": OUTLINED}
    mark(shown.blind, "never-observed-crosses", "x", 0.7, **cross)


def _legend(shown: Shown) -> list[tuple[Any, str]]:
    middle = colormaps[shown.colours](0.4 if shown.colours == DELAYS else 0.75)
    dot: dict[str, Any] = {"ls": "", "mec": INK, "mew": 0.9, "ms": 10}
    entries: list[tuple[Any, str]] = []
    if not shown.blind.all():
        entries.append((Line2D([], [], marker="o", mfc=middle, **dot), "observed, or partly"))
    if shown.blind.any():
        cross = Line2D([], [], ls="", marker="x", ms=6, mew=1.6, color=INK)
        square = Line2D([], [], marker="s", mfc=middle, **dot)
        which = " in a run" if shown.colours == CHANGES else ""
        entries.append(((square, cross), f"never observed{which} ({shown.blind.sum()})"))
    if np.isnan(shown.values).any():
        words = f"where nobody came{' in a run' if shown.colours == CHANGES else ''}"
        entries.append((Line2D([], [], marker="o", mfc=WHITE, **dot), words))
    return entries
