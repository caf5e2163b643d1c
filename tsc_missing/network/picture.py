"""A network as a picture: its roads, its intersections, and which of their sensors are missing."""

import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from tsc_missing.errors import UserError
from tsc_missing.network.coverage import Coverage
from tsc_missing.network.model import Network
from tsc_missing.network.picture_legend import (
    LINE,
    Inches,
    add_colour_bar,
    add_legend,
    add_scale_bar,
    add_title,
    caption_lines,
    legend_entries,
    nothing_with,
)
from tsc_missing.network.picture_marks import draw_intersections, draw_lanes, draw_roads, road_band
from tsc_missing.network.picture_names import draw_names
from tsc_missing.network.picture_style import POINTS, Sizes, choose_sizes, top_share
from tsc_missing.network.roads import Road

SUFFIXES = (".pdf", ".png", ".svg")
DPI = 200
MARGIN = 0.3  # [inches]
GUTTER = 0.25  # [inches], between the map and what stands beside it
COLUMN = 2.6  # [inches], what stands beside a tall map
SHORT, LONG = 5.0, 10.5  # [inches], the longer side of the map, by the number of blocks
SCALE_BAR = 1.7  # [inches], at most
WIDE = 1.2  # width by height, from where on the legend stands below
NO_DATES = {".pdf": {"CreationDate": None}, ".svg": {"Date": None}}


@dataclass(frozen=True)
class Layout:
    """Where the parts of the picture go, in inches from its left and bottom."""

    figure: Inches  # width and height
    map: tuple[float, float, float, float]  # left, bottom, width, height
    title: Inches  # top left corner
    legend: Inches  # top left corner
    colours: Inches  # top left corner of the colour bar, where there is one
    metres: Inches  # left end of the scale bar
    scale: float  # inches a metre

    @property
    def points(self) -> float:
        """Points a metre."""
        return POINTS * self.scale


def draw_network(
    network: Network,
    roads: Sequence[Road],
    name: str,
    caption: str = "",
    coverage: Coverage | None = None,
    names: bool = False,
) -> Figure:
    """The picture of a network.

    ``coverage`` is what its sensors deliver, None to show nothing of them; ``names`` writes the
    intersections' ids beside their marks.
    """
    sizes = choose_sizes(network, roads)
    shares = Normalize(0.0, top_share(coverage) if coverage is not None else 1.0)
    entries = legend_entries(network.n, coverage)
    colours = coverage is not None and bool(coverage.partly.any())
    layout = choose_layout(sizes, len(entries) + names, colours, caption)
    figure = Figure(figsize=layout.figure, dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    axes = map_axes(figure, layout, sizes)
    draw_roads(axes, roads, sizes)
    if coverage is not None:
        draw_lanes(axes, network, roads, sizes, layout.points, coverage, shares)
    draw_intersections(axes, network, sizes, layout.points, coverage, shares)
    if names:
        bands = [road_band(road, sizes) for road in roads]
        note = draw_names(figure, axes, network.ids, network.coordinates, sizes.radius, bands)
        entries += [nothing_with(note)] if note else []
    add_title(figure, layout.title, layout.figure[0] - 2 * MARGIN, name, caption)
    add_legend(figure, layout.legend, entries)
    if colours:
        add_colour_bar(figure, layout.colours, COLUMN - 0.3, shares)
    add_scale_bar(figure, layout.metres, layout.scale, SCALE_BAR)
    return figure


def choose_layout(sizes: Sizes, lines: int, colours: bool, caption: str) -> Layout:
    """Room for the map by its aspect: under a wide map, beside a tall one, stands the legend.

    ``lines`` are the legend's, ``colours`` tells whether there is a colour bar.
    """
    aspect = sizes.width / sizes.height
    wide = aspect >= WIDE
    blocks = max(sizes.width, sizes.height) / sizes.block
    longest = min(max(SHORT, 3.5 + 0.4 * blocks), LONG)
    width, height = (longest, longest / aspect) if wide else (longest * aspect, longest)
    page = width if wide else max(width + GUTTER + COLUMN, COLUMN)
    legend, bars = LINE * lines, 0.35 + 0.8 * colours
    panel = max(legend, bars) + GUTTER if wide else 0.0
    top = MARGIN + panel + height
    head = 0.4 + 0.17 * (caption_lines(caption, page).count("\n") + 1) if caption else 0.4
    if wide:
        corner, side = (MARGIN, MARGIN + panel - GUTTER), MARGIN + width - COLUMN
    else:
        corner, side = (MARGIN + width + GUTTER, top - GUTTER), MARGIN + width + GUTTER
    below = corner[1] if wide else corner[1] - legend - GUTTER
    return Layout(
        figure=(page + 2 * MARGIN, top + head + MARGIN),
        map=(MARGIN, MARGIN + panel, width, height),
        title=(MARGIN, top + head),
        legend=corner,
        colours=(side, below),
        metres=(side, below - 0.8 * colours - 0.08),
        scale=width / sizes.width,
    )


def map_axes(figure: Figure, layout: Layout, sizes: Sizes) -> Axes:
    """The axes in metres that fill the map's place."""
    wide, high = layout.figure
    left, bottom, width, height = layout.map
    axes = figure.add_axes((left / wide, bottom / high, width / wide, height / high), label="map")
    axes.set_axis_off()
    axes.set_xlim(sizes.bounds[0], sizes.bounds[2])
    axes.set_ylim(sizes.bounds[1], sizes.bounds[3])
    axes.set_autoscale_on(False)
    return axes


def check_picture_path(path: Path, field: str) -> None:
    """Raise ``UserError`` unless a picture can be written to ``path``; leaves nothing behind."""
    if path.suffix.lower() not in SUFFIXES:
        raise UserError(field, path, f"it must end in {', '.join(SUFFIXES)}")
    if path.is_dir():
        raise UserError(field, path, "it is a folder; give the name of a file")
    folder = path.absolute().parent
    if not folder.is_dir():
        raise UserError(field, path, f"there is no folder {folder}")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise UserError(field, path, f"no permission to write in {folder}")


def save_picture(figure: Figure, path: Path, field: str) -> None:
    """Write the picture in the format of the file's suffix; it is whole or not there.

    The same picture always gives the same bytes. An older picture is replaced.
    """
    check_picture_path(path, field)
    suffix = path.suffix.lower()
    temporary: Path | None = None
    try:
        handle, made = tempfile.mkstemp(prefix=f".{path.stem}.", dir=path.absolute().parent)
        os.close(handle)
        temporary = Path(made)
        with rc_context({"svg.hashsalt": "tsc-missing"}):
            figure.savefig(temporary, format=suffix[1:], metadata=NO_DATES.get(suffix))
        temporary.chmod(0o644)
        temporary.replace(path)
    except OSError as error:
        raise UserError(field, path, f"cannot be written ({error.strerror})") from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
