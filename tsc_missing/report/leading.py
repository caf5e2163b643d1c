"""Which methods a figure shows in colour, and what a reader is told of it."""

import math
from collections.abc import Collection

from tsc_missing.report.results import Results
from tsc_missing.report.statistics import mean_of
from tsc_missing.report.style import COLOURS

MOST = 5  # in colour, where there are more than colours


def leading_methods(results: Results, metric: str) -> tuple[str, ...]:
    """The methods to show in colour: all if there are few, else the best five.

    The best conventional one is always among them. Best is the smallest geometric mean, over the
    cases that a method was run on, of its metric divided by the case's best; what sees everything
    is not ranked.
    """
    if len(results.methods) <= len(COLOURS):
        return results.methods
    ranked = sorted(_distances(results, metric).items(), key=lambda item: item[1])
    order = [method for method, _ in ranked]
    first = next((m for m in order if results.kinds[m] == "conventional"), None)
    chosen = order[:MOST]
    if first is not None and first not in chosen:
        chosen = [*order[: MOST - 1], first]
    return tuple(method for method in results.methods if method in chosen)


def line_words(results: Results, metric: str, shown: Collection[str]) -> list[str]:
    """Sentences about what dots and colours mean, of the methods whose lines are ``shown``."""
    words = []
    references = [method for method in results.references if method in shown]
    if references:
        they = "it runs" if len(references) == 1 else "they run"
        see = "sees" if len(references) == 1 else "see"
        words.append(f"Dotted: {', '.join(references)}; {they} inside SUMO and {see} everything.")
    leading = leading_methods(results, metric)
    if any(method not in leading for method in shown):
        words.append(
            f"In colour the {len(leading)} methods that are best over all cases, the others grey; "
            "the scale is that of the methods in colour."
        )
    return words


def _distances(results: Results, metric: str) -> dict[str, float]:
    """The mean logarithm of each method's metric over the best one's."""
    logs: dict[str, list[float]] = {}
    for dataset in results.datasets:
        for case in results.cases(dataset):
            means = {
                method: mean.value
                for method in results.methods
                if results.kinds[method] != "reference"
                and (mean := mean_of(list(results.values(dataset, case, method, metric).values())))
            }
            best = min(means.values(), default=0.0)
            for method, value in means.items():
                if best > 0:
                    logs.setdefault(method, []).append(math.log(value / best))
    return {method: sum(all_) / len(all_) for method, all_ in logs.items()}
