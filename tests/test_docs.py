"""What the documents say can be found: their links, and their tables in the committed runs."""

import csv
import re
from collections import defaultdict
from pathlib import Path
from statistics import mean

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
LINK = re.compile(r"\]\(([^)\s]+)\)")
CASES = ("none", "random 50 %", "kriging 25 %")


def anchors(page):
    """Those of its headings, as they are made of them: words in lower case, joined by dashes."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    titles = re.findall(r"^#+ (.*)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for link in LINK.findall(text):
        if "://" in link:
            continue
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        assert target.exists(), link
        if anchor:
            assert anchor in anchors(target), link


def by_cell(report):
    """(travel time, delay) [s] of each method, dataset and case: means over seeds."""
    found = defaultdict(list)
    with (ROOT / "docs" / "results" / report / "runs.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            entered = int(row["inserted"]) / int(row["demand_vehicles"])
            delay = float(row["time_loss"]) * entered + float(row["depart_delay"])
            key = row["method"], row["dataset"], row["case"]
            found[key].append((float(row["att_all"]), delay))
    return {key: tuple(map(mean, zip(*values, strict=True))) for key, values in found.items()}


def tables(page):
    """Each table: its columns but the first, and its rows by their first cell."""
    for block in re.findall(r"(?:^\|.*\n)+", page.read_text(encoding="utf-8"), re.MULTILINE):
        head, _, *rows = ([c.strip() for c in line.split("|")[1:-1]] for line in block.splitlines())
        yield head[1:], {name: cells for name, *cells in rows}


def test_the_benchmark_is_what_its_runs_came_to():
    cells = by_cell("benchmark")
    shown = [it for it in tables(ROOT / "docs" / "benchmark.md") if "hangzhou_1" in it[0]]
    assert len(shown) == 3
    for which, (datasets, rows) in enumerate(shown[:2]):
        assert len(rows) == 4
        for method, values in rows.items():
            for dataset, words in zip(datasets, values, strict=True):
                numbers = [cells[method, dataset, case][which] for case in CASES]
                assert words == " / ".join(f"{number:.1f}" for number in numbers)


def test_what_is_said_of_runs_without_counts_is_what_they_came_to():
    cells = by_cell("uncounted")
    names = {
        "max-queue on the diffusion model's values": "max-queue, diffusion everywhere",
        "max-queue, a fixed cycle where blind": "max-queue",
        "actuated-recall (needs no counts)": "actuated-recall",
    }
    datasets, rows = [*tables(ROOT / "docs" / "benchmark.md")][-1]
    assert len(rows) == 5
    for name, values in rows.items():
        for dataset, words in zip(datasets, values, strict=True):
            assert words == f"{cells[names.get(name, name), dataset, 'kriging 25 %'][0]:.1f}"
