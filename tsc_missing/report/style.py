"""How the figures look: for print, and for people who see colours differently.

A few methods are in colour, the others grey (``leading.py`` chooses). The colours are those of
Okabe and Ito (2008), without the yellow; markers and line styles differ too, so that methods can be
told apart without colours.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.optimize import isotonic_regression

from tsc_missing.network.picture_style import INK, QUIET

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
GREY = "#8d99a6"
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">")
LINES = ("-", (0, (5, 1.5)), (0, (6, 1.5, 1.5, 1.5)), (0, (6, 1.5, 1.5, 1.5, 1.5, 1.5)))
DOTTED = (0, (1.2, 1.4))  # of references, which see everything, and of nothing else
ARROW = "\u2191"  # at the edge of a scale, before the value of what is above it
DPI = 160
PANEL = (3.6, 2.7)  # [inches]
COLUMNS = 3
LEGEND_LINE = 0.21  # [inches]
LONGEST = 42  # characters of a label at the end of a line, or in a legend
LABEL_LINE = 0.135  # [inches], of a label at the end of a line


@dataclass(frozen=True)
class Look:
    """How a method is drawn."""

    colour: str
    marker: str
    line: object


def looks(
    methods: Sequence[str], coloured: Collection[str], references: Collection[str] = ()
) -> dict[str, Look]:
    """A look for each method, those not ``coloured`` in grey, ``references`` dotted.

    No two in colour are alike for up to seventy, no two in grey for up to ten.
    """
    found = {}
    colours = greys = 0
    for method in methods:
        if method in coloured:
            k, colours = colours, colours + 1
            line = LINES[(k // len(COLOURS) + k) % len(LINES)]
            look = Look(COLOURS[k % len(COLOURS)], MARKERS[k % len(MARKERS)], line)
        else:
            k, greys = greys, greys + 1
            look = Look(GREY, MARKERS[-1 - k % len(MARKERS)], LINES[0])
        found[method] = replace(look, line=DOTTED) if method in references else look
    return found


def panels(
    count: int, legend: int, columns: int = COLUMNS, size: tuple[float, float] = PANEL
) -> tuple[Figure, list[Axes]]:
    """A figure of ``count`` axes with room for a legend of so many entries below them."""
    across = min(count, columns)
    down = -(-count // across)
    lines = -(-legend // legend_columns(across * size[0]))
    foot = LEGEND_LINE * lines + 0.15 if legend else 0.0
    width, height = across * size[0], down * size[1] + foot
    figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    engine = figure.get_layout_engine()
    assert engine is not None
    engine.set(rect=(0, foot / height, 1, 1 - foot / height))  # type: ignore[call-arg]
    grid = figure.subplots(down, across, squeeze=False).ravel().tolist()
    for unused in grid[count:]:
        unused.set_axis_off()
    for axes in grid[:count]:
        tidy(axes)
    return figure, grid[:count]


def legend_columns(width: float) -> int:
    """How many entries stand side by side in so many inches."""
    return max(1, int(width / 3.4))


def tidy(axes: Axes) -> None:
    """Quiet axes: no box, a light grid."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(QUIET)
    axes.grid(visible=True, color="#e1e5e9", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8, labelcolor=INK, color=QUIET)


def label(axes: Axes, title: str = "", x: str = "", y: str = "") -> None:
    """Words of an axes."""
    axes.set_title(title, size=9.5, color=INK, loc="left", parse_math=False)
    axes.set_xlabel(x, size=8.5, color=INK)
    axes.set_ylabel(y, size=8.5, color=INK)


def add_legend(figure: Figure, handles: Sequence[Line2D]) -> None:
    """The legend below the axes."""
    figure.legend(
        handles=list(handles),
        loc="lower left",
        ncols=legend_columns(figure.get_figwidth()),
        frameon=False,
        fontsize=8,
        labelcolor=INK,
        handlelength=2.6,
        borderaxespad=0.3,
    )


@dataclass(frozen=True)
class End:
    """Where a line ends, in data, and the words that stand at its right."""

    x: float
    y: float
    words: str
    colour: str


def scale_top(coloured: Sequence[float], others: Sequence[float], low: float) -> float:
    """The upper end of a scale that begins at ``low``, so that the coloured lines fill it.

    Other values are on it too if they do not take more than a third of it.
    """
    high = max(coloured, default=max(others, default=low))
    room = high + 0.5 * (high - low)
    top = max([high, *(value for value in others if value <= room)])
    return top + max(0.06 * (top - low), 1e-9 * abs(top), 1e-9)


def label_ends(axes: Axes, ends: Sequence[End], place: float = 1.05) -> None:
    """Words beside the ends of lines, moved apart as far as they must; y limits are set before.

    An end above the scale is named at its upper edge, with an arrow and its value.
    """
    if not ends:
        return
    low, high = axes.get_ylim()
    height = axes.get_window_extent().height / DPI  # [inches]
    gap = LABEL_LINE / height  # of the height of the axes
    leader = {"arrowstyle": "-", "linewidth": 0.6, "shrinkA": 1, "shrinkB": 3, "relpos": (0, 0.5)}
    short = {"color": GREY, "linestyle": (0, (5, 8))}  # it must not look like a method's line
    ends, last = sorted(ends, key=lambda end: end.y), max(end.x for end in ends)
    wanted = np.array([(min(end.y, high) - low) / (high - low) for end in ends])
    steps = gap * np.arange(len(ends))
    # the nearest places that are a gap apart and not above the axes
    places = np.minimum(isotonic_regression(wanted - steps).x, 1.0 - steps[-1]) + steps
    for end, y in zip(ends, places, strict=True):
        above = end.y > high
        look = short if end.x < last else {"color": end.colour}
        words = shortened(end.words) + (f" {ARROW}\u202f{end.y:.0f}" if above else "")
        axes.annotate(
            words,
            (end.x, min(end.y, high)),
            (place, y),
            textcoords="axes fraction",
            va="center",
            size=7.5,
            color=end.colour if end.colour != GREY else QUIET,
            parse_math=False,
            annotation_clip=False,
            arrowprops=None if above else leader | look,
        )


def shortened(words: str) -> str:
    """Words that fit beside a line: of long ones, as those of own code are, begin and end."""
    if len(words) <= LONGEST:
        return words
    return f"{words[: LONGEST // 3]}…{words[1 - LONGEST + LONGEST // 3 :]}"


def line_sample(look: Look, words: str, marker: bool = True) -> Line2D:
    """A legend's entry."""
    return Line2D(
        [],
        [],
        color=look.colour,
        linestyle=look.line,  # type: ignore[arg-type]
        marker=look.marker if marker else "",
        markersize=4.5,
        linewidth=1.4,
        label=shortened(words),
    )
