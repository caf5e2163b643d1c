"""What the words under a figure say is drawn in it."""

import pytest

from tests.report.cases import make_batch
from tsc_missing.report.document import make_report
from tsc_missing.report.figures import rate_figure
from tsc_missing.report.queues import queue_figure
from tsc_missing.report.results import Results, read_results
from tsc_missing.report.style import COLOURS, DOTTED, looks

GREY_WORDS = ("In colour the 2 methods", "the others grey")


@pytest.fixture
def results(tmp_path):
    return read_results([make_batch(tmp_path / "b", tmp_path, decisions=True)])


@pytest.fixture
def few_in_colour(monkeypatch):
    """Two methods are in colour, the others grey."""
    monkeypatch.setattr("tsc_missing.report.leading.COLOURS", COLOURS[:3])
    monkeypatch.setattr("tsc_missing.report.leading.MOST", 2)


def of(results, wanted):
    return Results(results.plans, [run for run in results.runs if wanted(run.spec)])


def dotted(figure):
    """The colours of the lines that are dotted, with how many there are of each."""
    lines = [line for panel in figure.axes for line in panel.lines]
    found = [line.get_color() for line in lines if line._unscaled_dash_pattern == DOTTED]
    return {colour: found.count(colour) for colour in found}


def test_only_references_are_dotted():
    names = [f"method {k}" for k in range(40)]
    for coloured in (names, ()):
        style = looks(names, coloured, names[7:9])
        assert [name for name in names if style[name].line == DOTTED] == names[7:9]
    assert style[names[7]] != style[names[8]]


def test_the_rates_say_what_is_dotted(results):
    figure, words = rate_figure(results, "att_all")
    colour = looks(results.methods, results.methods)["delay_based"].colour
    assert dotted(figure) == {colour: 2}  # panels
    assert "Dotted: delay_based; it runs inside SUMO and sees everything." in words
    figure, words = rate_figure(of(results, lambda s: s.method != "delay_based"), "att_all")
    assert dotted(figure) == {}
    assert "Dotted" not in words


def test_a_reference_at_fewer_rates_goes_on_dotted(results):
    some = of(results, lambda s: s.method != "delay_based" or s.case == "none")
    figure, _ = rate_figure(some, "att_all")
    colour = looks(results.methods, results.methods)["delay_based"].colour
    assert dotted(figure) == {colour: 4}  # what ran, and what goes on, in each panel


def test_the_rates_speak_of_bars_and_arrows_that_are_there(results, few_in_colour):
    some = of(results, lambda s: s.method != "delay_based")
    _, words = rate_figure(some, "att_all")
    assert "Bars are standard errors over seeds." in words
    assert "An arrow is at a line" in words
    assert all(word in words for word in GREY_WORDS)
    near = of(some, lambda s: s.method not in ("max-pressure", "rate 10"))
    _, words = rate_figure(near, "att_all")
    assert "An arrow" not in words
    _, words = rate_figure(of(results, lambda s: s.settings.seed == 0), "att_all")
    assert "Bars" not in words


def test_queues_speak_of_grey_lines_that_are_there(results):
    _, words = queue_figure(results, "att_all")
    assert words == "Dotted: delay_based; it runs inside SUMO and sees everything."


def test_grey_queues_may_leave_the_scale(results, few_in_colour):
    figure, words = queue_figure(results, "att_all")
    assert "Grey lines may leave the scale." in words
    assert all(word in words for word in GREY_WORDS)
    shown = [text.get_text() for text in figure.legends[0].get_texts()]
    assert shown == ["Diff_Light", "max-queue", "the other methods", "SUMO's own programs"]


def test_seeds_that_make_no_difference_are_explained_for_all_demands(results):
    runs = [run for run in results.runs if run.spec.settings.seed == 0]
    rows = [run.row for run in runs]
    again = [run for run in results.runs if run.spec.settings.seed == 1]
    for run, row in zip(again, rows, strict=True):
        run.row["att_all"] = row["att_all"]
    text = make_report(Results(results.plans, [*runs, *again]), "att_all").markdown
    assert "± 0.0: the seeds make next to no difference." in text
    assert "a recorded or generated one" in text
