"""What single losses cost: the table, and the map whose marks are its rows."""

import re
from dataclasses import replace

import numpy as np
import pytest

from tests.report.cases import STEPS, make_batch, write_decisions
from tsc_missing.evaluation.scenario import find_scenario
from tsc_missing.report.document import make_report
from tsc_missing.report.loss_map import loss_maps
from tsc_missing.report.losses import loss_table
from tsc_missing.report.queues import FEW, queue_figure
from tsc_missing.report.results import Results, read_results
from tsc_missing.sensing.masks import save_mask

COSTS = {"max-queue": (0.1, 0.3, 0.0, 0.2), "max-pressure": (0.0, 0.1, 0.4, 0.1)}
SHORT = [f"crossing_{k}" for k in range(4)]
LONG = [f"cluster_{k}{k}{k}1234567_{k}987654321" for k in range(4)]


def results_of(tmp_path, cases):
    """Runs that each lose one of the first intersections, beside those that lose none."""
    made = read_results([make_batch(tmp_path / "b", tmp_path)])
    network = find_scenario("jinan_1", "auto").folder.network
    runs = []
    for whole in made.runs:
        if whole.spec.case != "none" or whole.spec.method not in COSTS:
            continue
        runs.append(whole)
        for n, (case, cost) in enumerate(zip(cases, COSTS[whole.spec.method], strict=True)):
            mask = np.ones((STEPS, network.n, 12), dtype=bool)
            mask[:, n] = ~network.slot_mask[n]
            folder = tmp_path / f"{whole.spec.name}-{n}"
            folder.mkdir()
            save_mask(folder / "mask.npz", mask, network.ids)
            missing = {"pattern": "file", "file": f"{case}.csv"}
            settings = whole.spec.settings.model_copy(
                update={"missing": whole.spec.settings.missing.model_copy(update=missing)}
            )
            spec = whole.spec.model_copy(update={"case": case, "settings": settings})
            row = {**whole.row, "att_all": whole.row["att_all"] * (1 + cost)}
            runs.append(replace(whole, spec=spec, row=row, folder=folder))
    return Results(made.plans, runs)


def names_on_map(results, method):
    """What stands beside each mark."""
    maps = {name: figure for name, figure, _ in loss_maps(results, "att_all")}
    figure = maps[f"losses-jinan_1-{method}"]
    return {text.get_text() for text in figure.texts if text.get_gid() == "name"}, figure


@pytest.mark.parametrize(("cases", "numbered"), [(SHORT, False), (LONG, True)])
def test_marks_are_rows_of_the_table(tmp_path, cases, numbered):
    results = results_of(tmp_path, cases)
    lines = [line for line in loss_table(results, "jinan_1", "att_all") if line]
    assert lines[0].startswith("| no. | silent |" if numbered else "| silent |")
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]
    found = [[c for c in row if c.startswith(("+", "−"))] for row in rows]
    order = [2, 1, 3, 0]  # by the larger of the costs
    assert found == [[f"+{100 * COSTS[m][n]:.1f} %" for m in COSTS] for n in order]
    names = [row[1 if numbered else 0].replace("\\", "") for row in rows]
    assert names == [cases[n] for n in order]
    for k, method in enumerate(COSTS):
        shown, figure = names_on_map(results, method)
        costs = [row[k] for row in found]
        if numbered:
            assert [row[0] for row in rows] == ["1", "2", "3", "4"]
            assert shown == {f"{row[0]}\n{cost}" for row, cost in zip(rows, costs, strict=True)}
        else:
            ends = {name.removeprefix("crossing_") for name in names}
            assert {text.partition("\n")[0].removeprefix("crossing_") for text in shown} == ends
            assert {text.partition("\n")[2] for text in shown} == {*costs}
        legend = [text.get_text() for text in figure.legends[0].get_texts()]
        assert ("numbers: rows of the table" in legend) == numbered


def test_the_text_says_in_which_order_rows_are(tmp_path):
    text = make_report(results_of(tmp_path, LONG), "att_all").markdown
    said = re.search(r"## What each loss costs\n\n(.*)\n", text).group(1)
    assert "by the largest number in a row" in said
    assert "Maps have the rows' numbers (no.)." in said


def test_queues_have_panels_of_the_costliest_alone(tmp_path, monkeypatch):
    results = results_of(tmp_path, SHORT)
    network = find_scenario("jinan_1", "auto").folder.network
    for run in results.runs:
        write_decisions(run.folder / "decisions.parquet", network.n, 0)

    def shown():
        figure, words = queue_figure(results, "att_all")
        titles = [panel.get_title(loc="left") for panel in figure.axes]
        return [title.partition(", ")[2] for title in titles if title], FEW in words

    whole = "everything observed"
    assert shown() == ([whole, *SHORT], False)
    monkeypatch.setattr("tsc_missing.report.queues.MOST_LISTED", 2)
    assert shown() == ([whole, "crossing_1", "crossing_2"], True)
