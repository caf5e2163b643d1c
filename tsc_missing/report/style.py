"""How the figures look: for print, and for people who see colours differently.

The colours are those of Okabe and Ito (2008), without the yellow; markers and line styles differ
too, so that methods can be told apart without colours.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tsc_missing.network.picture_style import INK, QUIET

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">")
LINES = ("-", (0, (5, 1.5)), (0, (1.5, 1.5)), (0, (6, 1.5, 1.5, 1.5)))
DPI = 160
PANEL = (3.6, 2.7)  # [inches]
COLUMNS = 3
LEGEND_LINE = 0.21  # [inches]
TITLE = 0.45  # [inches]


@dataclass(frozen=True)
class Look:
    """How a method is drawn."""

    colour: str
    marker: str
    line: object


def looks(methods: Sequence[str]) -> dict[str, Look]:
    """A look for each method; no two are alike for up to seventy."""
    return {
        method: Look(
            COLOURS[k % len(COLOURS)],
            MARKERS[k % len(MARKERS)],
            LINES[(k // len(COLOURS) + k) % len(LINES)],
        )
        for k, method in enumerate(methods)
    }


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
        label=words,
    )
