"""The figures about numbers: rates, generalisation, imputation."""

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tsc_missing.network.picture_style import INK, QUIET
from tsc_missing.report.results import NOTHING_MISSING, Results
from tsc_missing.report.statistics import mean_of
from tsc_missing.report.style import MARKERS, add_legend, label, line_sample, looks, panels

Group = tuple[str, bool]  # a pattern, and whether kriging is adjacent

UNITS = {"att_all": "mean travel time (att_all), s", "att_approach": "time on approaches, s"}


def axis_words(metric: str) -> str:
    """A metric as the words of an axis."""
    return UNITS.get(metric, metric.replace("_", " "))


def rate_figure(results: Results, metric: str) -> Figure | None:
    """The metric against the missing rate: a line a method, a panel a dataset and pattern.

    Rate 0 is the case without missing data. None where no pattern has two rates.
    """
    wanted = [
        (dataset, group)
        for dataset in results.datasets
        for group in _groups(results, dataset)
        if len(_rates(results, dataset, group)) > 1
    ]
    if not wanted:
        return None
    style = looks(results.methods)
    figure, axes = panels(len(wanted), len(results.methods), columns=2)
    for panel, (dataset, group) in zip(axes, wanted, strict=True):
        rates = _rates(results, dataset, group)
        for method in results.methods:
            points = [
                (100 * rate, mean)
                for rate, case in rates.items()
                if (mean := mean_of(list(results.values(dataset, case, method, metric).values())))
            ]
            if not points:
                continue
            look = style[method]
            panel.errorbar(
                [rate for rate, _ in points],
                [mean.value for _, mean in points],
                [mean.error or 0.0 for _, mean in points],
                color=look.colour,
                marker=look.marker,
                linestyle=look.line,
                markersize=4.5,
                linewidth=1.4,
                capsize=2,
            )
        label(panel, f"{dataset}, {_group_words(group)}", "missing, %", axis_words(metric))
        panel.set_xlim(left=-2)
    add_legend(figure, [line_sample(style[m], m) for m in results.methods])
    return figure


def _groups(results: Results, dataset: str) -> list[Group]:
    specs = [run.spec for run in results.finished if run.spec.dataset == dataset]
    found = dict.fromkeys(
        (s.settings.missing.pattern, s.settings.missing.adjacent)
        for s in specs
        if s.case != NOTHING_MISSING
    )
    return list(found)


def _group_words(group: Group) -> str:
    return f"{group[0]}{' (adjacent)' if group[1] else ''} missing"


def _rates(results: Results, dataset: str, group: Group) -> dict[float, str]:
    """The cases of a pattern by rate, that without missing data at 0."""
    found = {}
    for run in results.finished:
        missing = run.spec.settings.missing
        if run.spec.dataset != dataset:
            continue
        if run.spec.case == NOTHING_MISSING or (missing.pattern, missing.adjacent) == group:
            found[missing.rate] = run.spec.case
    return dict(sorted(found.items()))


def generalisation_figure(results: Results, metric: str) -> Figure | None:
    """The paper's matrix P_r = P_g / P_o: trained on the row's case, tested on the column's.

    P_o is what weights trained on the column's own case reach. None without such weights.
    """
    wanted, matrices = [], []
    for dataset in results.datasets:
        trained = {
            run.spec.trained: run.spec.method
            for run in results.finished
            if run.spec.trained is not None and run.spec.dataset == dataset
        }
        for group in _groups(results, dataset):
            cases = [
                case
                for case in _rates(results, dataset, group).values()
                if case in trained and results.of(dataset, case, trained[case])
            ]
            if len(cases) > 1:
                wanted.append((dataset, group, cases))
                matrices.append(_generalisation(results, dataset, cases, trained, metric))
    if not wanted:
        return None
    away = max(0.05, max(float(np.nanmax(np.abs(m - 1))) for m in matrices))
    norm = TwoSlopeNorm(1.0, 1 - away, 1 + away)
    figure, axes = panels(len(wanted), 0, columns=2, size=(3.6, 3.2))
    image = None
    for panel, (dataset, group, cases), matrix in zip(axes, wanted, matrices, strict=True):
        image = panel.imshow(matrix, cmap="PuOr_r", norm=norm)
        panel.grid(visible=False)
        for (row, column), value in np.ndenumerate(matrix):
            if np.isfinite(value):
                dark = abs(value - 1) > 0.65 * away
                panel.text(
                    column,
                    row,
                    f"{value:.2f}",
                    ha="center",
                    va="center",
                    size=9,
                    color="white" if dark else INK,
                )
        rates = [case.rpartition(" ")[0].rpartition(" ")[2] for case in cases]
        panel.set_xticks(range(len(cases)), rates)
        panel.set_yticks(range(len(cases)), rates)
        title = f"{dataset}, {_group_words(group)}"
        label(panel, title, "tested at, % missing", "trained at, % missing")
    assert image is not None
    bar = figure.colorbar(image, ax=axes, shrink=0.7)
    bar.set_label("travel time / that of weights trained at the tested rate", size=8, color=INK)
    bar.ax.tick_params(labelsize=8)
    return figure


def _generalisation(
    results: Results, dataset: str, cases: Sequence[str], trained: dict[str, str], metric: str
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """(row: trained on, column: tested on)."""
    matrix = np.full((len(cases), len(cases)), np.nan)
    for row, source in enumerate(cases):
        for column, case in enumerate(cases):
            there = mean_of(list(results.values(dataset, case, trained[source], metric).values()))
            own = mean_of(list(results.values(dataset, case, trained[case], metric).values()))
            if there is not None and own is not None:
                matrix[row, column] = there.value / own.value
    return matrix


def imputation_figure(results: Results, metric: str) -> Figure | None:
    """The metric against the error of imputation: colours are methods, markers are cases."""
    points: dict[str, list[tuple[str, str, float, float]]] = {}
    for cell in results.by_cell:
        errors = results.values(cell.dataset, cell.case, cell.method, "imputation_mae")
        values = results.values(cell.dataset, cell.case, cell.method, metric)
        error, value = mean_of(list(errors.values())), mean_of(list(values.values()))
        if error is not None and value is not None:
            point = (cell.case, cell.method, error.value, value.value)
            points.setdefault(cell.dataset, []).append(point)
    if not points:
        return None
    flat = [point for all_ in points.values() for point in all_]
    cases = list(dict.fromkeys(case for case, _, _, _ in flat))
    methods = list(dict.fromkeys(method for _, method, _, _ in flat))
    style = looks(results.methods)
    shapes = {case: MARKERS[k % len(MARKERS)] for k, case in enumerate(cases)}
    figure, axes = panels(len(points), len(cases) + len(methods), columns=2)
    for panel, (dataset, all_) in zip(axes, points.items(), strict=True):
        for case, method, error_, value_ in all_:
            panel.scatter(
                error_,
                value_,
                s=34,
                marker=shapes[case],
                facecolor=style[method].colour,
                edgecolor=INK,
                linewidth=0.5,
            )
        label(panel, dataset, "imputation error, vehicles (mean absolute)", axis_words(metric))
    blank = {"linestyle": "", "markeredgecolor": INK, "markeredgewidth": 0.5, "markersize": 6}
    samples = [
        Line2D([], [], marker="o", markerfacecolor=style[m].colour, label=m, **blank)  # type: ignore[arg-type]
        for m in methods
    ]
    samples += [
        Line2D([], [], marker=shapes[c], markerfacecolor=QUIET, label=c, **blank)  # type: ignore[arg-type]
        for c in cases
    ]
    add_legend(figure, samples)
    return figure
