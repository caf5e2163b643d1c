"""The tables of a report: results, comparisons, decision times."""

import math
from collections.abc import Sequence
from statistics import fmean, median

from tsc_missing.report.markdown import (
    NOTHING,
    change_words,
    escaped,
    marked,
    mean_words,
    table,
)
from tsc_missing.report.results import NOTHING_MISSING, Results
from tsc_missing.report.statistics import Pairs, mean_of, paired, ratio_of

SEES_ALL = "°"
MOST_COLUMNS = 10  # cases beside each other
OUTSIDE = 0.01  # share of the demand that never entered, from which it is worth a word


def named(results: Results, method: str) -> str:
    """A method's name, marked where it sees everything."""
    mark = SEES_ALL if results.kinds[method] == "reference" else ""
    return f"{escaped(method)}{mark}"


def result_table(results: Results, dataset: str, metric: str) -> list[str]:
    """A row a method, a column a case: mean ± standard error, best and second marked."""
    cases = results.cases(dataset)
    digits = _digits(results, dataset, metric)
    columns = [_column(results, dataset, case, metric, digits) for case in cases]
    methods = [m for m in results.methods if any(m in column for column in columns)]
    rows = [[named(results, m), *(column.get(m, NOTHING) for column in columns)] for m in methods]
    return _wide_or_long(["method", *map(escaped, cases)], rows)


def _digits(results: Results, dataset: str, metric: str) -> int:
    """After the point: one, and so many that the largest value of a dataset has three in all."""
    values = (
        abs(value)
        for case in results.cases(dataset)
        for method in results.methods
        for value in results.values(dataset, case, method, metric).values()
    )
    most = max(values, default=0.0)
    return max(1, 2 - math.floor(math.log10(most))) if most > 0 else 1


def _wide_or_long(header: list[str], rows: list[list[str]]) -> list[str]:
    """A table with a column a case; with a row a case where that would be too wide to read."""
    if len(header) - 1 <= MOST_COLUMNS:
        return table(header, rows)
    turned = [list(line) for line in zip(header, *rows, strict=True)]
    return table(["case", *turned[0][1:]], turned[1:])


def _column(results: Results, dataset: str, case: str, metric: str, digits: int) -> dict[str, str]:
    """The cells of a case by method, with their marks."""
    values = {m: list(results.values(dataset, case, m, metric).values()) for m in results.methods}
    means = {m: mean for m, all_ in values.items() if (mean := mean_of(all_)) is not None}
    most = max((mean.n for mean in means.values() if mean.error is not None), default=1)
    ranks = ranking(
        {m: mean.value for m, mean in means.items() if results.kinds[m] != "reference"}, digits
    )
    cells = {}
    for method, mean in means.items():
        few = f" ({mean.n} of {most})" if mean.n < most else ""
        cells[method] = marked(mean_words(mean, digits), ranks.get(method)) + few
    return cells


def ranking(values: dict[str, float], digits: int) -> dict[str, int]:
    """The rank of each name, 0 for the smallest value; equal as printed is equal in rank.

    One name alone has no rank.
    """
    if len(values) < 2:
        return {}
    shown = {name: round(value, digits) for name, value in values.items()}
    order = sorted(set(shown.values()))
    return {name: order.index(value) for name, value in shown.items()}


def best_conventional(results: Results, dataset: str, case: str, metric: str) -> str | None:
    """The conventional method with the smallest mean, of those with the most seeds."""
    means = {
        m: mean
        for m in results.methods
        if results.kinds[m] == "conventional"
        and (mean := mean_of(list(results.values(dataset, case, m, metric).values())))
    }
    return min(means, key=lambda m: (-means[m].n, means[m].value)) if means else None


def comparison_table(results: Results, dataset: str, metric: str) -> list[str]:
    """Each method against the best conventional one of the case, seed by seed."""
    cases = results.cases(dataset)
    bases = {case: best_conventional(results, dataset, case, metric) for case in cases}
    rows = []
    for method in results.methods:
        cells = [
            "base"
            if bases[case] == method
            else change_words(ratio_of([_pairs(results, dataset, case, method, base, metric)]))
            for case in cases
            for base in [bases[case]]
        ]
        if any(cell != NOTHING for cell in cells):
            rows.append([named(results, method), *cells])
    against = ["*base*", *(escaped(base) if base else NOTHING for base in bases.values())]
    return _wide_or_long(["method", *map(escaped, cases)], [against, *rows])


def _pairs(
    results: Results, dataset: str, case: str, method: str, base: str | None, metric: str
) -> Pairs:
    against = {} if base is None else results.values(dataset, case, base, metric)
    return paired(results.values(dataset, case, method, metric), against)


def pooled_table(results: Results, metric: str) -> list[str]:
    """Each method against the best conventional one, over all cases with missing data."""
    strata = [
        (dataset, case)
        for dataset in results.datasets
        for case in results.cases(dataset)
        if case != NOTHING_MISSING
    ]
    rows = []
    for method in results.methods:
        pairs = []
        for dataset, case in strata:
            base = best_conventional(results, dataset, case, metric)
            pairs.append(_pairs(results, dataset, case, method, base, metric))
        ratio = ratio_of(pairs)
        there = [p for p in pairs if len(p)]
        if ratio is None:
            continue
        better = sum(bool((p.values[:, 0] < p.values[:, 1]).sum() * 2 > len(p)) for p in there)
        rows.append(
            [
                named(results, method),
                change_words(ratio),
                f"{better} of {len(there)} cases",
                str(ratio.n),
            ]
        )
    if not rows:
        return []
    return table(["method", "over all cases", "better in", "runs"], rows)


def time_table(results: Results) -> list[str]:
    """The median decision [ms] of each method: a column a dataset, in cases that all of it have.

    Over seeds it is the median, over cases the mean. A method without some of the cases that most
    have is not shown there.
    """
    columns = [_decisions(results, dataset) for dataset in results.datasets]
    rows = [
        [named(results, method), *(column.get(method, NOTHING) for column in columns)]
        for method in results.methods
        if any(method in column for column in columns)
    ]
    return table(["method", *map(escaped, results.datasets)], rows)


def _decisions(results: Results, dataset: str) -> dict[str, str]:
    """By method, of those that have all cases in which most methods have decision times."""
    times: dict[str, dict[str, float]] = {}
    for case in results.cases(dataset):
        for method in results.methods:
            values = results.values(dataset, case, method, "decision_ms_median").values()
            if values:
                times.setdefault(case, {})[method] = median(values)
    most: dict[str, float] = max(times.values(), key=len, default={})
    shared = [of_case for of_case in times.values() if of_case.keys() >= most.keys()]
    return {method: f"{fmean(of_case[method] for of_case in shared):.2f}" for method in most}


def warnings(results: Results) -> list[str]:
    """What a reader must know about runs that did not go as runs should."""
    counts: dict[tuple[str, str], list[str]] = {}
    for run in results.finished:
        most = {"never_inserted": OUTSIDE * (run.row["demand_vehicles"] or 0)}
        for key, words in (
            ("gridlock", "gridlocked at the end"),
            ("fallbacks", "answered by the safe fallback in part"),
            ("collisions", "with collisions"),
            ("teleports", "with teleports"),
            (
                "never_inserted",
                f"with more than {100 * OUTSIDE:.0f} % of the vehicles outside",
            ),
        ):
            if (run.row[key] or 0) > most.get(key, 0):  # null where an older version wrote it
                counts.setdefault((run.spec.method, words), []).append(run.spec.name)
    return [
        f"{escaped(method)}: {len(names)} {'run' if len(names) == 1 else 'runs'} {words} "
        f"({_some(names)})"
        for (method, words), names in counts.items()
    ]


def _some(names: Sequence[str], most: int = 3) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(f"`{name}`" for name in names[:most]) + more
