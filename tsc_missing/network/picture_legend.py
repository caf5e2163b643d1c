"""What stands beside the map of a network: its title, legend, scale bar and colour bar."""

import textwrap
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, PercentFormatter

from tsc_missing.network.coverage import Coverage
from tsc_missing.network.picture_style import HATCH, INK, NEVER, QUIET, ROAD, SHARES, WHITE

LINE = 0.235  # [inches], the height of a legend's line
CHARACTERS = 14.0  # of the caption in an inch

Inches = tuple[float, float]  # from the figure's left and bottom


def legend_entries(n: int, coverage: Coverage | None) -> list[tuple[Any, str]]:
    """A sample and words for everything that the map shows of ``n`` intersections."""
    entries: list[tuple[Any, str]] = [(Patch(facecolor=ROAD), "road, a band for each direction")]
    if coverage is None:
        return [*entries, (_dot(INK, INK), f"intersection with signals ({n})")]
    partly, blind = int(coverage.partly.sum()), int(coverage.blind.sum())
    middle = colormaps[SHARES](0.55)
    cross = Line2D([], [], ls="", marker="x", ms=6, mew=1.6, color=WHITE)
    square = Line2D([], [], ls="", marker="s", ms=10, mfc=NEVER, mec=INK, mew=0.9)
    if partly + blind < n:
        entries.append((_dot(WHITE, INK), f"always observed ({n - partly - blind})"))
    if partly:
        entries.append((_dot(middle, INK), f"partly observed ({partly})"))
    if blind:
        entries.append(((square, cross), f"never observed ({blind})"))
    lanes = coverage.missing[coverage.uneven]
    edge: dict[str, Any] = {"edgecolor": WHITE, "linewidth": 0.4}
    if coverage.uneven.any():
        entries.append((Patch(facecolor=middle, **edge), "lane, where lanes differ"))
    if (lanes >= 1).any():
        entries.append((Patch(facecolor=NEVER, hatch=HATCH, **edge), "lane that never reports"))
    return entries


def nothing_with(words: str) -> tuple[Any, str]:
    """An entry without a sample."""
    return Line2D([], [], ls=""), words


def _dot(fill: Any, edge: str) -> Artist:
    return Line2D([], [], ls="", marker="o", ms=10, mfc=fill, mec=edge, mew=0.9)


def add_title(figure: Figure, corner: Inches, width: float, name: str, caption: str) -> None:
    """The name and under it the caption, wrapped to ``width`` [inches], from a top left corner."""
    x, y = _share(figure, corner)
    figure.text(x, y, name, size=15, weight="bold", color=INK, va="top", parse_math=False)
    _, y = _share(figure, (corner[0], corner[1] - 0.31))
    figure.text(
        x, y, caption_lines(caption, width), size=9.5, color=QUIET, va="top", parse_math=False
    )


def caption_lines(caption: str, width: float) -> str:
    """The caption in lines that fit into ``width`` [inches]."""
    return textwrap.fill(caption, max(20, int(CHARACTERS * width)))


def add_legend(figure: Figure, corner: Inches, entries: list[tuple[Any, str]]) -> None:
    """The legend, from its top left corner."""
    figure.legend(
        [sample for sample, _ in entries],
        [words for _, words in entries],
        handler_map={tuple: HandlerTuple(ndivide=1)},
        loc="upper left",
        bbox_to_anchor=_share(figure, corner),
        frameon=False,
        fontsize=9.5,
        labelcolor=INK,
        borderpad=0,
        borderaxespad=0,
        handlelength=1.6,
        handleheight=0.9,
        labelspacing=0.55,
    )


def add_scale_bar(figure: Figure, corner: Inches, scale: float, width: float) -> None:
    """A bar of a round number of metres, at most ``width`` [inches], at ``scale`` inches a metre.

    ``corner`` is its left end.
    """
    metres = round_length(width / scale)
    (x, y), (end, high) = (
        _share(figure, corner),
        _share(figure, (corner[0] + metres * scale, corner[1] + 0.06)),
    )
    low = 2 * y - high
    bar = Line2D(
        [x, x, x, end, end, end],
        [low, high, y, y, high, low],
        color=INK,
        lw=1.4,
        solid_joinstyle="miter",
        transform=figure.transFigure,
        gid="scale-bar",
    )
    figure.add_artist(bar)
    _, below = _share(figure, (corner[0], corner[1] - 0.1))
    figure.text((x + end) / 2, below, f"{metres:g} m", size=9, color=INK, ha="center", va="top")


def round_length(most: float) -> float:
    """The largest of 1, 2, 5, 10, 20, 50, … that is at most ``most``."""
    power = 10.0 ** np.floor(np.log10(most))
    return float(max(step * power for step in (1, 2, 5) if step * power <= most * (1 + 1e-9)))


def add_colour_bar(
    figure: Figure,
    corner: Inches,
    width: float,
    shares: Normalize,
    words: str = "share of missing readings",
    colours: str = SHARES,
    percent: bool = True,
    decimals: int = 0,
) -> None:
    """The colours of the shares of missing readings, or of what the ``words`` say.

    ``corner`` is the bar's top left.
    """
    x, y = _share(figure, (corner[0], corner[1] - 0.14))
    wide, high = _share(figure, (width, 0.14))
    axes = figure.add_axes((x, y, wide, high), label="colour bar")
    bar = figure.colorbar(
        ScalarMappable(shares, colours),
        cax=axes,
        orientation="horizontal",
        ticks=MaxNLocator(5, steps=[1, 2, 5, 10]),
        format=PercentFormatter(1.0, decimals=decimals, symbol=" %") if percent else None,
    )
    bar.set_label(words, size=9.5, color=INK)
    bar.outline.set_linewidth(0.6)
    axes.tick_params(labelsize=9, labelcolor=INK, color=INK, length=3)


def _share(figure: Figure, place: Inches) -> tuple[float, float]:
    """A place in inches as shares of the figure."""
    width, height = figure.get_size_inches()
    return float(place[0] / width), float(place[1] / height)
