"""What reports say of methods and cases that did not run alike."""

import json
from dataclasses import replace

import pytest

from tests.report.cases import make_batch, with_settings
from tsc_missing.config import SensorSettings, SignalSettings
from tsc_missing.report.conditions import mixed_sources
from tsc_missing.report.document import make_report
from tsc_missing.report.queues import queue_figure
from tsc_missing.report.results import Results, read_results

AREA = {"sensor": SensorSettings(kind="area")}
OF_METHODS = "Methods of one case did not run alike, so they differ in more than the method:"
OF_CASES = "Cases did not run alike, so they cannot be compared with each other:"


@pytest.fixture
def results(tmp_path):
    return read_results([make_batch(tmp_path / "b", tmp_path, decisions=True)])


def report(results):
    return make_report(results, "att_all").markdown


def test_methods_that_ran_with_other_timing_are_told_of(results):
    assert "did not run alike" not in report(results)
    slower = {"signals": SignalSettings(yellow=3)}
    text = report(with_settings(results, lambda s: slower if s.method == "max-pressure" else {}))
    assert OF_METHODS in text
    assert OF_CASES not in text
    lines = [line for line in text.splitlines() if "signals.yellow" in line]
    few, many = "Diff\\_Light, max-queue, delay\\_based", "rate 10, rate 50"
    assert lines == [
        f"- jinan\\_1 (none, kriging 25 %), signals.yellow 5: {few}; 3: max-pressure",
        f"- jinan\\_1 (random 10 %, random 50 %), signals.yellow 5: {few}, {many}; 3: max-pressure",
    ]


def test_cases_with_other_sensors_are_told_of_where_methods_do_not_differ(results):
    patterns = with_settings(
        results, lambda s: AREA if s.settings.missing.pattern == "kriging" else {}
    )
    text = report(patterns)
    assert OF_METHODS not in text
    where = "sensor lane: none, random 10 %, random 50 %; area of 50 m: kriging 25 %"
    assert f"{OF_CASES}\n\n- jinan\\_1, {where}\n" in text


def test_cases_and_methods_of_one_of_them_may_differ(results):
    def change(spec):
        one = spec.case == "random 10 %" and spec.method == "max-queue"
        return AREA if one or spec.case == "kriging 25 %" else {}

    text = report(with_settings(results, change))
    assert f"{OF_METHODS}\n\n- jinan\\_1 (random 10 %), sensor lane: Diff" in text
    where = "sensor lane: none, random 50 %; area of 50 m: kriging 25 %"
    assert f"{OF_CASES}\n\n- jinan\\_1, {where}\n" in text


def test_panels_of_queues_name_sensors_that_differ(results):
    def titles(figure):
        return [panel.get_title(loc="left") for panel in figure.axes]

    figure, words = queue_figure(results, "att_all")
    assert not any("sensor" in text for text in [*titles(figure), words])
    one = with_settings(results, lambda s: AREA if s.case == "kriging 25 %" else {})
    figure, words = queue_figure(one, "att_all")
    assert titles(figure)[1:] == [
        "jinan_1, random 50 %\nsensor: lane",
        "jinan_1, kriging 25 %\nsensor: area of 50 m",
    ]
    assert "queues of panels with other sensors cannot be compared" in words
    figure, words = queue_figure(with_settings(results, lambda s: AREA), "att_all")
    assert not any("sensor" in text for text in [*titles(figure), words])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"count_error": 0.3}, "count\\_error 0.0: Diff"),
        ({"imputer": "last"}, "imputer sfm-4: Diff"),
        ({"signals": SignalSettings(max_red=90)}, "signals.max\\_red 240: Diff"),
        ({"signals": SignalSettings(min_space=9)}, "signals.min\\_space None: Diff"),
    ],
)
def test_settings_that_decide_are_told_of_unless_a_label_or_a_method_says_them(
    results, changes, words
):
    inner = words.split()[0].replace("\\", "")

    def told(**more):
        runs = with_settings(results, lambda s: changes if s.method == "max-queue" else {}).runs
        said = [
            replace(run, spec=run.spec.model_copy(update=more if more else {}))
            if run.spec.method == "max-queue"
            else run
            for run in runs
        ]
        return [line for line in report(Results(results.plans, said)).splitlines() if words in line]

    assert [line.startswith("- jinan\\_1 (none, kriging 25 %), ") for line in told()] == [
        True,
        False,
    ]
    assert told(defined=(inner,)) == []
    assert told(method=f"max-queue, {inner.rpartition('.')[2]} 9") == []
    assert told(defined=None) != []  # of an old plan, a controller
    assert told(defined=None, method="mine") == []  # and what may have a definition


def test_suites_say_what_defines_their_methods(results):
    defined = {run.spec.method: run.spec.defined for run in results.runs}
    assert defined["max-queue"] == ("controller",)
    assert defined["rate 10"] == ("controller", "diffusion.weights")


def test_cells_of_several_revisions_are_counted(results):
    assert mixed_sources(results) is None

    def of_two(run):
        source = str(run.spec.settings.seed == 0 and run.spec.method == "max-queue")
        return replace(run, row={**run.row, "versions": json.dumps({"source": source})})

    changed = Results(results.plans, map(of_two, results.runs))
    words = mixed_sources(changed)
    assert words == (
        "4 cells are means over runs of more than one source revision (jinan_1: none: max-queue; "
        "jinan_1: random 10 %: max-queue; jinan_1: random 50 %: max-queue; and 1 more)."
    )
    assert report(changed).count("source revision") == 1
