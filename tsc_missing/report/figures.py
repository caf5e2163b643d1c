"""The figures about numbers: rates, generalisation, imputation."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure

from tsc_missing.config import MEAN_OUTAGE, MissingSettings
from tsc_missing.network.picture_style import INK
from tsc_missing.report.leading import leading_methods, line_words
from tsc_missing.report.results import NOTHING_MISSING, Results
from tsc_missing.report.statistics import Mean, mean_of
from tsc_missing.report.style import (
    ARROW,
    GREY,
    End,
    Look,
    add_legend,
    label,
    label_ends,
    line_sample,
    looks,
    panels,
    scale_top,
)

Group = tuple[str, str, float]  # a pattern, its variant, the mean outage
Points = list[tuple[float, Mean]]

DARK = 0.2  # relative luminance of a colour below which white words are easier to read
MOST_TICKS = 6  # rates that are written below the axis as they are
CROWDED = 14  # characters of all ticks that still fit beside each other

UNITS = {"att_all": "mean travel time (att_all), s", "att_approach": "time on approaches, s"}


def axis_words(metric: str) -> str:
    """A metric as the words of an axis."""
    return UNITS.get(metric, metric.replace("_", " "))


def rate_figure(results: Results, metric: str) -> tuple[Figure, str] | None:
    """The metric against the missing rate: a line a method, a panel a dataset and pattern.

    Rate 0 is the case without missing data. None where no pattern has two rates. With sentences
    about what is drawn.
    """
    wanted = [
        (dataset, group)
        for dataset in results.datasets
        for group in _groups(results, dataset)
        if len(_rates(results, dataset, group)) > 1
    ]
    if not wanted:
        return None
    style = looks(results.methods, leading_methods(results, metric), results.references)
    figure, axes = panels(len(wanted), 0, columns=2, size=(4.2, 2.7))
    drawn: dict[str, Points] = {}
    for panel, (dataset, group) in zip(axes, wanted, strict=True):
        rates = _rates(results, dataset, group)
        lines = {
            method: points
            for method in results.methods
            if (points := _points(results, dataset, rates, method, metric))
        }
        for method, points in lines.items():
            _draw_line(panel, points, style[method])
            drawn.setdefault(method, []).extend(points)
        _scale(panel, lines, style)
        label(panel, f"{dataset}, {_group_words(group)}", "missing, %", axis_words(metric))
        last = 100 * max(rates)
        if len(rates) <= MOST_TICKS:
            ticks = [100 * rate for rate in rates]
            words = [f"{tick:.4g}" for tick in ticks]
            turned = 45 if len("".join(words)) > CROWDED else 0
            panel.set_xticks(ticks, words, rotation=turned)
        for method, points in lines.items():
            if method in results.references and points[-1][0] < last:
                x, y, look = points[-1][0], points[-1][1].value, style[method]
                panel.plot([x, last], [y, y], color=look.colour, lw=0.9, ls=look.line, zorder=1)
        ends = [
            End(last if m in results.references else x, mean.value, m, style[m].colour)
            for m, points in lines.items()
            for x, mean in points[-1:]
        ]
        label_ends(panel, ends)
    return figure, " ".join(_rate_words(results, metric, drawn, axes))


def _rate_words(
    results: Results, metric: str, drawn: dict[str, Points], axes: Sequence[Axes]
) -> list[str]:
    words = [*line_words(results, metric, drawn), "The scales do not begin at 0."]
    if any(mean.error for points in drawn.values() for _, mean in points):
        words.insert(0, "Bars are standard errors over seeds.")
    if any(ARROW in text.get_text() for panel in axes for text in panel.texts):
        words.append("An arrow is at a line that ends above the scale, with its value there.")
    return words


def _points(
    results: Results, dataset: str, rates: dict[float, str], method: str, metric: str
) -> Points:
    """Missing [%] and mean of a method's cases."""
    return [
        (100 * rate, mean)
        for rate, case in rates.items()
        if (mean := mean_of(list(results.values(dataset, case, method, metric).values())))
    ]


def _draw_line(panel: Axes, points: Points, look: Look) -> None:
    grey = look.colour == GREY
    panel.errorbar(
        [x for x, _ in points],
        [mean.value for _, mean in points],
        [mean.error or 0.0 for _, mean in points],
        color=look.colour,
        marker=look.marker,
        linestyle=look.line,
        markersize=3.5 if grey else 4.5,
        linewidth=0.9 if grey else 1.5,
        capsize=2,
        zorder=2 if grey else 3,
    )


def _scale(panel: Axes, lines: dict[str, Points], style: dict[str, Look]) -> None:
    """The scale that the coloured lines fill."""
    parts: tuple[list[float], list[float]] = ([], [])
    for method, points in lines.items():
        grey = style[method].colour == GREY
        parts[grey].extend(mean.value + (mean.error or 0.0) for _, mean in points)
    low = min(mean.value - (mean.error or 0.0) for all_ in lines.values() for _, mean in all_)
    top = scale_top(*parts, low=low)
    panel.set_ylim(low - 0.05 * (top - low), top)


def _groups(results: Results, dataset: str) -> list[Group]:
    specs = [run.spec for run in results.finished if run.spec.dataset == dataset]
    found = dict.fromkeys(
        _group(s.settings.missing)
        for s in specs
        if s.case != NOTHING_MISSING and not s.settings.missing.file
    )
    return list(found)


def _group(missing: MissingSettings) -> Group:
    return missing.pattern, missing.variant, missing.mean_outage


def _group_words(group: Group) -> str:
    pattern, variant, outage = group
    steps = "" if outage == MEAN_OUTAGE else f" (outages of {outage:g} steps)"
    return f"{pattern}{f' ({variant})' if variant else ''} missing{steps}"


def _rates(results: Results, dataset: str, group: Group) -> dict[float, str]:
    """The cases of a pattern by rate, that without missing data at 0."""
    found = {}
    for run in results.finished:
        missing = run.spec.settings.missing
        if run.spec.dataset != dataset:
            continue
        if run.spec.case == NOTHING_MISSING or _group(missing) == group:
            found[missing.rate] = run.spec.case
    return dict(sorted(found.items()))


def generalisation_figure(results: Results, metric: str) -> tuple[Figure, str] | None:
    """The paper's matrix P_r = P_g / P_o: trained on the row's case, tested on the column's.

    P_o is what weights trained on the column's own case reach. None without such weights. With a
    sentence about weights that are not shown.
    """
    wanted, matrices = [], []
    others: dict[str, None] = {}
    for dataset in results.datasets:
        trained, more = _trained(results, dataset)
        for group in _groups(results, dataset):
            rates = {
                rate: case
                for rate, case in _rates(results, dataset, group).items()
                if case in trained and results.of(dataset, case, trained[case])
            }
            matrix = _generalisation(results, dataset, [*rates.values()], trained, metric)
            if len(rates) > 1 and np.isfinite(matrix).any():
                wanted.append((dataset, group, [f"{100 * rate:.4g}" for rate in rates]))
                matrices.append(matrix)
                others |= dict.fromkeys(m for m, case in more.items() if case in rates.values())
    if not wanted:
        return None
    away = max(0.05, max(float(np.nanmax(np.abs(m - 1))) for m in matrices))
    norm = TwoSlopeNorm(1.0, 1 - away, 1 + away)
    figure, axes = panels(len(wanted), 0, columns=2, size=(3.6, 3.2))
    image = None
    for panel, (dataset, group, ticks), matrix in zip(axes, wanted, matrices, strict=True):
        image = panel.imshow(matrix, cmap="PuOr_r", norm=norm)
        panel.grid(visible=False)
        for (row, column), value in np.ndenumerate(matrix):
            if np.isfinite(value):
                red, green, blue, _ = np.power(image.cmap(norm(value)), 2.2)
                dark = 0.2126 * red + 0.7152 * green + 0.0722 * blue < DARK
                panel.text(
                    column,
                    row,
                    f"{value:.3f}",
                    ha="center",
                    va="center",
                    size=8.5,
                    color="white" if dark else INK,
                )
        panel.set_xticks(range(len(ticks)), ticks)
        panel.set_yticks(range(len(ticks)), ticks)
        title = f"{dataset}, {_group_words(group)}"
        label(panel, title, "tested at, % missing", "trained at, % missing")
    assert image is not None
    bar = figure.colorbar(image, ax=axes, shrink=0.7)
    bar.set_label("travel time / that of weights\ntrained at the tested rate", size=8.5, color=INK)
    bar.ax.tick_params(labelsize=8)
    words = "Of weights that were trained on one case the first are shown, and not"
    return figure, f"{words} {', '.join(others)}." if others else ""


def _trained(results: Results, dataset: str) -> tuple[dict[str, str], dict[str, str]]:
    """By the case that weights were trained on the first method, and others with their cases."""
    first: dict[str, str] = {}
    others: dict[str, str] = {}
    for spec in (run.spec for run in results.finished if run.spec.dataset == dataset):
        if spec.trained is None:
            continue
        if first.setdefault(spec.trained, spec.method) != spec.method:
            others[spec.method] = spec.trained
    return first, others


def _generalisation(
    results: Results, dataset: str, cases: Sequence[str], trained: dict[str, str], metric: str
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """(row: trained on, column: tested on); NaN without results, or where the own is 0."""
    matrix = np.full((len(cases), len(cases)), np.nan)
    for row, source in enumerate(cases):
        for column, case in enumerate(cases):
            there = mean_of(list(results.values(dataset, case, trained[source], metric).values()))
            own = mean_of(list(results.values(dataset, case, trained[case], metric).values()))
            if there is not None and own is not None and own.value > 0:
                matrix[row, column] = there.value / own.value
    return matrix


def imputation_figure(results: Results, metric: str) -> Figure | None:
    """The metric against the error of imputation: a panel a dataset and pattern.

    A method's rates are joined by a line, and the more is missing the larger is the marker.
    """
    panels_: dict[tuple[str, Group], dict[str, list[tuple[float, float, float]]]] = {}
    for dataset in results.datasets:
        for group in _groups(results, dataset):
            for rate, case in _rates(results, dataset, group).items():
                for method in results.methods:
                    errors = results.values(dataset, case, method, "imputation_mae")
                    values = results.values(dataset, case, method, metric)
                    error, value = mean_of(list(errors.values())), mean_of(list(values.values()))
                    if error is not None and value is not None:
                        lines = panels_.setdefault((dataset, group), {})
                        lines.setdefault(method, []).append((rate, error.value, value.value))
    if not panels_:
        return None
    style = looks(results.methods, leading_methods(results, metric))
    shown = [m for m in results.methods if any(m in lines for lines in panels_.values())]
    figure, axes = panels(len(panels_), len(shown), columns=2)
    for panel, ((dataset, group), lines) in zip(axes, panels_.items(), strict=True):
        rates = sorted({rate for points in lines.values() for rate, _, _ in points})
        for method, points in lines.items():
            look = style[method]
            _, x, y = zip(*points, strict=True)
            panel.plot(x, y, color=look.colour, linestyle=look.line, linewidth=0.9)
            sizes = [26.0 + 14.0 * rates.index(rate) for rate, _, _ in points]
            panel.scatter(
                x, y, sizes, look.colour, marker=look.marker, edgecolors=INK, lw=0.5, alpha=0.85
            )
        words = f"{dataset}, {_group_words(group)}"
        if len(rates) == 1:
            words += f" at {100 * rates[0]:g} %"
        label(panel, words, "imputation error, vehicles (mean absolute)", axis_words(metric))
        panel.margins(0.08)
    add_legend(figure, [line_sample(style[m], m) for m in shown])
    return figure
