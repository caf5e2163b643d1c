"""What outages that were listed cost: the table, and the words by which maps refer to its rows."""

from tsc_missing.network.picture_names import common_prefix
from tsc_missing.report.markdown import change_words, escaped, table
from tsc_missing.report.results import NOTHING_MISSING, Results
from tsc_missing.report.statistics import Ratio, paired, ratio_of
from tsc_missing.report.tables import named

NUMBER = "no."  # the column of the rows' numbers
LONGEST = 12  # characters of a case on a map, without what all cases begin with


def loss_table(results: Results, dataset: str, metric: str) -> list[str]:
    """What each outage costs each method beside nothing missing, the worst first.

    Nothing where there are none, or nothing to hold them against. Rows are numbered where their
    names are too long for maps.
    """
    cases = costly_cases(results, dataset, metric)
    costs = {
        m: {case: ratio for case in cases if (ratio := cost_of(results, dataset, case, m, metric))}
        for m in results.methods
    }
    methods = [method for method in results.methods if costs[method]]
    if not methods:
        return []
    header = ["silent", *(named(results, method) for method in methods)]
    rows = [
        [escaped(case), *(change_words(costs[method].get(case)) for method in methods)]
        for case in cases
    ]
    if not _are_short(cases):
        header = [NUMBER, *header]
        rows = [[str(k), *row] for k, row in enumerate(rows, 1)]
    return table(header, rows, words=len(header) - len(methods))


def map_labels(results: Results, dataset: str, metric: str) -> dict[str, str]:
    """How maps call each case of the table's rows: by its name, or all by their numbers."""
    cases = costly_cases(results, dataset, metric)
    if _are_short(cases):
        return {case: case for case in cases}
    return {case: str(k) for k, case in enumerate(cases, 1)}


def cost_of(results: Results, dataset: str, case: str, method: str, metric: str) -> Ratio | None:
    """A case of a method over nothing missing; None where there is nothing to compare."""
    whole = results.values(dataset, NOTHING_MISSING, method, metric)
    return ratio_of([paired(results.values(dataset, case, method, metric), whole)])


def listed_cases(results: Results, dataset: str) -> list[str]:
    """The cases that are a list of outages or a mask that was given."""
    listed = {
        run.spec.case
        for run in results.finished
        if run.spec.dataset == dataset and run.spec.settings.missing.file
    }
    return [case for case in results.cases(dataset) if case in listed]


def costly_cases(results: Results, dataset: str, metric: str) -> list[str]:
    """The listed cases with any cost, by the largest that they have with any method."""
    most = {}
    for case in listed_cases(results, dataset):
        ratios = (cost_of(results, dataset, case, method, metric) for method in results.methods)
        values = [ratio.value for ratio in ratios if ratio is not None]
        if values:
            most[case] = max(values)
    return sorted(most, key=lambda case: -most[case])


def _are_short(cases: list[str]) -> bool:
    """Whether the names of all fit on a map."""
    if not cases:
        return True
    return max(map(len, cases)) - len(common_prefix(cases)) <= LONGEST
