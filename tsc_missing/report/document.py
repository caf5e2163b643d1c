"""The report as Markdown, with its figures."""

import re
from dataclasses import dataclass

from tsc_missing.batch.check import lacking_words
from tsc_missing.batch.table import FAILED, WAITING
from tsc_missing.report.conditions import mixed_sources, unlike_cases, unlike_methods
from tsc_missing.report.losses import NUMBER, loss_table
from tsc_missing.report.markdown import escaped
from tsc_missing.report.paper import COMMON, METRIC, paper_table, paper_time_table
from tsc_missing.report.pictures import Picture, pictures_of
from tsc_missing.report.results import Results
from tsc_missing.report.scenes import without_network
from tsc_missing.report.tables import (
    SEES_ALL,
    comparison_table,
    pooled_table,
    result_table,
    time_table,
    warnings,
)

FIGURES = "figures"
METRIC_WORDS = {
    "att_all": " (mean travel time over all demand, waiting to enter included, in s)",
    "att_approach": " (mean time on the roads that lead to signals, in s)",
}


@dataclass(frozen=True)
class Report:
    """A report: its title, its Markdown and the figures that this refers to."""

    title: str
    markdown: str
    pictures: tuple[Picture, ...]


def make_report(results: Results, metric: str, command: str = "") -> Report:
    """Everything there is to say about the results; ``command`` is what made the report."""
    title = " and ".join(dict.fromkeys(plan.suite.title for plan in results.plans))
    pictures = tuple(pictures_of(results, metric))
    lines = [
        f"# {escaped(title)}",
        "",
        *_about(results),
        *_results(results, metric),
        *_losses(results, metric),
        *_comparison(results, metric),
        *_paper(results),
        *_times(results),
        *_figures(pictures),
        *_making(results, command),
    ]
    text = re.sub(r"\n{3,}", "\n\n", "\n".join(lines))
    return Report(title, text.rstrip() + "\n", pictures)


def _about(results: Results) -> list[str]:
    lines = []
    for plan in results.plans:
        if plan.suite.about:
            lines += [plan.suite.about.strip(), ""]
        if plan.lacking:
            lines += [f"Left out, no weights: {lacking_words(plan.lacking)}.", ""]
    for status, words in ((FAILED, "failed"), (WAITING, "not run")):
        runs = [run for run in results.runs if run.row["status"] == status]
        if runs:
            lines += [f"**{len(runs)} of {len(results.runs)} runs {words}:**", ""]
            lines += [f"- `{r.spec.name}`: {escaped(r.row['error'] or words)}" for r in runs[:20]]
            lines += [f"- and {len(runs) - 20} more"] if len(runs) > 20 else []
            lines.append("")
    notes = warnings(results)
    if notes:
        lines += ["Runs that did not go as runs should:", "", *(f"- {n}" for n in notes), ""]
    for differing, who, so in (
        (unlike_methods(results), "Methods of one case", "they differ in more than the method"),
        (unlike_cases(results), "Cases", "they cannot be compared with each other"),
    ):
        if differing:
            lines += [
                f"{who} did not run alike, so {so}:",
                "",
                *(f"- {escaped(one)}" for one in differing),
                "",
            ]
    mixed = mixed_sources(results)
    lines += [escaped(mixed), ""] if mixed else []
    gone = without_network(results)
    if gone:
        words = "No maps, as the network is not here as it was when it was run"
        lines += [f"{words}: {', '.join(map(escaped, gone))}.", ""]
    return lines


def _results(results: Results, metric: str) -> list[str]:
    tables = []
    for dataset in results.datasets:
        tables += [f"### {escaped(dataset)}", *result_table(results, dataset, metric)]
    lines = [
        "## Results",
        "",
        f"`{metric}`{METRIC_WORDS.get(metric, '')}, as mean ± standard error over seeds. Of each "
        "case (a column; a row where there are many) the best mean is **bold** and the second "
        "<ins>underlined</ins>, whether or not the difference is more than chance.",
        "",
    ]
    if any(re.search(r"± 0\.0+(?!\d)", line) for line in tables):
        lines += [
            "± 0.0: the seeds make next to no difference. Of demands only the bundled profiles are "
            "drawn with the seed; a recorded or generated one, as imported and generated networks "
            "have, is the same for every seed. Where nothing is missing no mask is drawn either.",
            "",
        ]
    if any(re.search(r"\(\d+ of \d+\)", line) for line in tables):
        words = "the others failed, wait, or were not asked for"
        lines += [f"(2 of 3) is a mean over two of three seeds; {words}.", ""]
    if "reference" in results.kinds.values():
        lines += [
            f"{SEES_ALL} runs inside SUMO and sees everything, whatever is missing: a reference, "
            "not ranked.",
            "",
        ]
    return lines + tables


def _losses(results: Results, metric: str) -> list[str]:
    tables = {d: loss_table(results, d, metric) for d in results.datasets}
    if not any(tables.values()):
        return []
    numbered = any(f"| {NUMBER} |" in line for rows in tables.values() for line in rows[:2])
    numbers = f" Maps have the rows' numbers ({NUMBER})." if numbered else ""
    lines = [
        "## What each loss costs",
        "",
        f"By how much `{metric}` is above (+, worse) that of the same method with nothing missing, "
        "paired by seed, with 95 % intervals as below; the costliest first, by the largest number "
        f"in a row, whichever method's it is.{numbers}",
        "",
    ]
    for dataset, rows in tables.items():
        lines += [f"### {escaped(dataset)}", *rows] if rows else []
    return lines


def _comparison(results: Results, metric: str) -> list[str]:
    if "conventional" not in results.kinds.values():
        return []
    lines = [
        "## Against the best conventional controller",
        "",
        f"By how much `{metric}` is above (+, worse) or below (−, better) that of the "
        "conventional method that is best in the same case (the base), paired by seed: same "
        "demand, same mask. In brackets the 95 % interval of 10 000 bootstrap samples of the "
        "seeds; with few seeds it is a rough guide, and too narrow: of three it is the range of "
        "the three. No brackets: all seeds agree "
        "as printed, or there is only one. The base was chosen on the same runs, which flatters "
        "it.",
        "",
    ]
    for dataset in results.datasets:
        lines += [f"### {escaped(dataset)}", *comparison_table(results, dataset, metric)]
    pooled = pooled_table(results, metric)
    if pooled:
        lines += [
            "### All cases with missing data",
            "",
            "The geometric mean of the ratios above over all datasets and cases with missing "
            "data, with the same seeds drawn in all of them; in how many of them the method is "
            "better than the base on most seeds; and the number of its runs. A method counts with "
            "0 % where it is the base itself. One that did not run in all cases cannot be compared "
            "with those that did.",
            *pooled,
        ]
    return lines


def _paper(results: Results) -> list[str]:
    rows, times = paper_table(results), paper_time_table(results)
    lines = []
    wanted = any(plan.suite.paper for plan in results.plans)
    if rows or wanted:
        lines += [
            "## Beside the paper",
            "",
            f"`{METRIC}`, the paper's metric, as a multiple of that of {COMMON} with everything "
            f"observed in the same simulator: the paper's numbers over {COMMON} in CityFlow, which "
            "was run for this (the paper does not have it), and ours over ours in SUMO. Below 1 is "
            f"better than {COMMON} with everything observed; *ours / paper* below 1 means that our "
            "run stands better to it than the paper's.",
            "",
        ]
        if not rows:
            lines += [
                f"Nothing to show: it takes {COMMON} without missing data and a method of the "
                f"paper on the same dataset and case, and a run of {COMMON} in CityFlow (there is "
                "none of New York).",
                "",
            ]
    lines += rows
    if times:
        lines += [
            "Decision times, and as multiples of that of the fewest sampling steps that the paper "
            "has (the paper's are of its own machine):",
            *times,
        ]
    return lines


def _times(results: Results) -> list[str]:
    lines = time_table(results)
    if not any("." in line for line in lines[3:]):
        return []
    head = (
        "Wall time of a decision for the whole network in ms, imputation included: the median of "
        "each run, of these the median over seeds, and of these the mean over the cases in which "
        "most methods ran; one without some of them is not shown. Runs shared the machine, so "
        "small differences mean nothing."
    )
    return ["## Decision time", "", head, *lines]


def _figures(pictures: tuple[Picture, ...]) -> list[str]:
    if not pictures:
        return []
    lines = ["## Figures", ""]
    for picture in pictures:
        lines += [
            f"![{escaped(picture.words.partition('. ')[0])}]({FIGURES}/{picture.name}.png)",
            "",
            f"*{escaped(picture.words)}*",
            "",
        ]
    return lines


def _making(results: Results, command: str) -> list[str]:
    versions = ", ".join(
        f"{name} {' and '.join(all_)}" for name, all_ in results.versions().items()
    )
    revisions = dict.fromkeys(str(run.row["git"]) for run in results.finished if run.row["git"])
    seeds = sorted({run.spec.settings.seed for run in results.finished})
    demand = ", ".join(dict.fromkeys(str(run.row["demand_kind"]) for run in results.finished))
    horizon = ", ".join(dict.fromkeys(f"{r.spec.settings.horizon} s" for r in results.finished))
    lines = ["## How it was made", ""]
    commands = [*(plan.command for plan in results.plans), command]
    lines += [f"    {each}" for each in commands if each]
    facts = f"{len(results.finished)} runs, {demand} demand, {horizon}, seeds {_seed_words(seeds)}"
    made = f"; {versions}" + (f"; revision {', '.join(revisions)}" if revisions else "")
    return [*lines, "", f"{facts}{made}.", ""]


def _seed_words(seeds: list[int]) -> str:
    whole = seeds == list(range(seeds[0], seeds[-1] + 1)) and len(seeds) > 2
    return f"{seeds[0]} to {seeds[-1]}" if whole else ", ".join(map(str, seeds))
