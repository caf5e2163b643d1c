"""Reports: their numbers, their figures, and the command."""

import base64
import csv
import html.parser
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.report.cases import make_batch, with_settings
from tsc_missing.batch.table import read_rows, write_table
from tsc_missing.config import SignalSettings
from tsc_missing.errors import UserError
from tsc_missing.report.document import make_report
from tsc_missing.report.figures import _generalisation, generalisation_figure
from tsc_missing.report.leading import leading_methods
from tsc_missing.report.markdown import escaped, mean_words, signed
from tsc_missing.report.paper import paper_table
from tsc_missing.report.queue_map import map_runs
from tsc_missing.report.queues import queue_figure, smooth
from tsc_missing.report.results import Results, read_results
from tsc_missing.report.statistics import Pairs, mean_of, paired, ratio_of
from tsc_missing.report.style import (
    COLOURS,
    GREY,
    LONGEST,
    End,
    label_ends,
    looks,
    panels,
    shortened,
)
from tsc_missing.report.tables import (
    _wide_or_long,
    best_conventional,
    comparison_table,
    pooled_table,
    ranking,
    result_table,
    time_table,
    warnings,
)

WEIGHTS = ("rate 10", "rate 50")
positive = st.floats(1.0, 1e4)


def cells(lines):
    """The cells of a Markdown table by its first column and header."""
    rows = [[c.strip() for c in line.strip("| ").split(" | ")] for line in lines if line]
    return {row[0]: dict(zip(rows[0][1:], row[1:], strict=True)) for row in rows[2:]}


def test_mean_and_standard_error():
    mean = mean_of([1.0, 2.0, 3.0])
    assert (mean.value, mean.n) == (2.0, 3)
    assert mean.error == pytest.approx(1 / np.sqrt(3))
    assert mean_words(mean) == "2.0 ± 0.6"
    assert mean_words(mean_of([4.0])) == "4.0"
    assert mean_of([]) is None


@given(st.lists(st.tuples(positive, positive), min_size=2, max_size=6), st.floats(0.5, 2))
def test_ratios_hold_what_they_say(pairs, factor):
    pairs = np.array(pairs)
    ratio = ratio_of([of_seeds(pairs)])
    assert ratio.value == pytest.approx(pairs[:, 0].mean() / pairs[:, 1].mean())
    low, high = ratio.interval
    each = pairs[:, 0] / pairs[:, 1]
    assert each.min() - 1e-9 <= low <= high <= each.max() + 1e-9
    scaled = ratio_of([of_seeds(pairs * [factor, 1])])
    assert scaled.value == pytest.approx(factor * ratio.value)
    constant = ratio_of([of_seeds(np.column_stack([factor * pairs[:, 1], pairs[:, 1]]))])
    assert constant.interval == pytest.approx((factor, factor))


def test_ratios_over_strata_and_pairs():
    one, other = of_seeds([[2.0, 1.0]]), of_seeds([[1.0, 2.0]])
    assert ratio_of([one, other]).value == pytest.approx(1.0)
    assert ratio_of([one]).interval is None
    assert ratio_of([paired({}, {})]) is None
    seeds = of_seeds([[0.9, 1.0], [1.0, 1.0], [1.2, 1.0]])
    assert ratio_of([seeds] * 20).interval == pytest.approx(ratio_of([seeds]).interval)
    for zero in ([[0.0, 2.0]], [[2.0, 0.0]], [[0.0, 0.0]], [[2.0, 1.0], [3.0, 0.0]]):
        assert ratio_of([of_seeds(zero)]) is None
        assert ratio_of([one, of_seeds(zero)]) == ratio_of([one])
    assert paired({1: 5.0, 0: 4.0}, {1: 7.0, 2: 8.0}).values.tolist() == [[5.0, 7.0]]


def test_a_seed_is_drawn_in_all_strata_or_in_none():
    """Whatever seeds a stratum has: those of a seed go up and down together."""
    effect = {0: 1.1, 1: 1.0, 2: 0.9}

    def stratum(*seeds):
        return paired({seed: effect[seed] for seed in seeds}, dict.fromkeys(seeds, 1.0))

    assert ratio_of([stratum(0, 1, 2)] * 2).interval == pytest.approx((0.9, 1.1))
    effect[0], effect[2] = (
        1.2,
        1.2,
    )  # beside each other in their order one would make up for the other
    low, high = ratio_of([stratum(0, 1), stratum(1, 2)]).interval
    assert (low, high) == pytest.approx((1.0, 1.2))
    far = paired({1: 3.0, 2: 3.6}, {1: 1.0, 2: 1.0})
    wide = ratio_of([stratum(0, 1), far])
    assert wide.interval == pytest.approx((low * 3**0.5, high * 3**0.5))


def of_seeds(pairs):
    return Pairs(tuple(range(len(pairs))), np.array(pairs, dtype=float).reshape(-1, 2))


def test_bootstrap_intervals_cover():
    """Of intervals of 20 normal pairs about as many hold the true ratio as they promise."""
    rng = np.random.default_rng(3)
    held = 0
    for _ in range(100):
        shared = rng.normal(300, 20, 20)
        pairs = np.column_stack([0.9 * shared, shared]) + rng.normal(0, 5, (20, 2))
        low, high = ratio_of([of_seeds(pairs)]).interval
        held += low <= 0.9 <= high
    assert 85 <= held <= 99


def test_equal_as_printed_is_equal_in_rank():
    assert ranking({"a": 1.04, "b": 1.02, "c": 2.0, "d": 3.0}, 1) == {
        "a": 0,
        "b": 0,
        "c": 1,
        "d": 2,
    }
    assert ranking({"a": 1.0}, 1) == {}


@pytest.fixture
def results(tmp_path):
    return read_results([make_batch(tmp_path / "b", tmp_path)])


def test_cases_are_in_the_order_of_their_rates(results):
    assert results.cases("jinan_1") == ("none", "random 10 %", "random 50 %", "kriging 25 %")


def test_queues_are_shown_at_the_highest_rate_of_each_pattern(tmp_path):
    results = read_results([make_batch(tmp_path / "b", tmp_path, decisions=True)])
    assert results.highest_cases("jinan_1") == ("none", "random 50 %", "kriging 25 %")
    titles = [panel.get_title(loc="left") for panel in queue_figure(results, "att_all")[0].axes]
    shown = ["everything observed", "random 50 %", "kriging 25 %"]
    assert [title for title in titles if title] == [f"jinan_1, {case}" for case in shown]


def test_tables(results):
    table = cells(result_table(results, "jinan_1", "att_all"))
    assert table["Diff\\_Light"]["none"] == "**293.0 ± 1.7**"
    assert table["max-queue"]["random 50 %"] == "<ins>313.0 ± 1.7</ins>"
    assert table["rate 50"]["random 10 %"] == "310.0 ± 1.7"
    assert table["max-queue"]["kriging 25 %"] == "<ins>308.0 ± 1.7</ins>"
    assert table["delay\\_based°"]["none"] == "203.0 ± 1.7"  # sees everything: not ranked
    assert table["rate 10"]["none"] == "–"

    assert best_conventional(results, "jinan_1", "random 50 %", "att_all") == "max-queue"
    compared = cells(comparison_table(results, "jinan_1", "att_all"))
    assert compared["max-queue"]["none"] == "base"
    assert compared["*base*"]["kriging 25 %"] == "max-queue"
    assert compared["max-pressure"]["none"].startswith("+16.5 % [+16.")
    assert compared["Diff\\_Light"]["none"] == "−3.3 %"  # [−3.3, −3.3] would look certain
    pooled = cells(pooled_table(results, "att_all"))
    assert pooled["Diff\\_Light"]["better in"] == "3 of 3 cases"
    assert pooled["max-queue"]["runs"] == "9"


def test_the_paper_beside_ours(results):
    lines = paper_table(results)
    row = next(line for line in lines if "kriging" in line)
    words = [word.strip() for word in row.strip("| ").split(" | ")]
    assert words[:3] == ["jinan\\_1", "kriging 25 %", "Diff\\_Light"]
    paper, ours, quotient = map(float, words[3:])
    assert paper == pytest.approx(329.67 / 268.9, abs=5e-4)
    assert ours == pytest.approx((290 + 5 + 3 - 60) / (300 + 3 - 60), abs=5e-4)
    assert quotient == pytest.approx(ours / paper, abs=2e-3)


def test_runs_unlike_the_papers_are_not_beside_it(results):
    def shorter(run):
        settings = run.spec.settings.model_copy(update={"horizon": 1800})
        return replace(run, spec=run.spec.model_copy(update={"settings": settings}))

    assert paper_table(Results(results.plans, map(shorter, results.runs))) == []


def test_the_common_controller_is_as_it_is_by_default(results):
    """Whatever comes first in the suite, ratios are to max-queue without room kept and the like."""

    def ratio(**changes):
        changed = with_settings(
            results, lambda spec: changes.get(spec.method.replace("-", "_"), {})
        )
        lines = paper_table(Results(changed.plans, reversed(changed.runs)))
        return float(lines[-2].split(" | ")[4]) if lines else None

    plain = ratio()
    common = {"controller": "max-queue"}
    kept = common | {"signals": SignalSettings(min_space=9)}
    assert ratio(max_pressure=kept) == plain
    assert ratio(max_pressure=common) == plain
    assert ratio(max_queue=kept, max_pressure=common) == pytest.approx(plain * 240 / 290, rel=0.01)
    for other in (kept, {"count_error": 0.3}, {"turning_counts": "none"}):
        assert ratio(max_queue=other) is None


def test_trained_weights_are_in_the_order_of_what_they_were_trained_on(results):
    runs = [run for run in reversed(results.runs) if run.spec.trained]
    assert Results(results.plans, runs).methods == ("rate 10", "rate 50")


def test_decision_times_are_of_cases_that_all_methods_share(results):
    """The weights ran at two rates only; there the others took longer than elsewhere."""

    def timed(run):
        if run.row["decision_ms_median"] is None:
            return run
        seed, rate = run.spec.settings.seed, run.spec.settings.missing.rate
        milliseconds = 2.0 + rate if run.spec.settings.missing.pattern == "random" else 1.0
        return replace(run, row={**run.row, "decision_ms_median": milliseconds + 50 * (seed == 2)})

    changed = Results(results.plans, map(timed, results.runs))
    times = {name: row["jinan\\_1"] for name, row in cells(time_table(changed)).items()}
    assert times == dict.fromkeys(["Diff\\_Light", "max-queue", "max-pressure", *WEIGHTS], "2.30")
    assert "Runs shared the machine" in make_report(changed, "att_all").markdown
    runs = [
        run
        for run in changed.runs
        if run.spec.method not in WEIGHTS
        and (run.spec.method != "max-pressure" or run.spec.case == "none")
    ]
    times = cells(time_table(Results(results.plans, runs)))
    assert {name: row["jinan\\_1"] for name, row in times.items()} == {
        "Diff\\_Light": "1.00",
        "max-queue": "1.00",
        "max-pressure": "1.00",
    }


def test_vehicles_that_stay_outside_are_told_of(results):
    assert warnings(results) == []
    first = results.runs[0]
    many, few = ({**first.row, "demand_vehicles": 1000, "never_inserted": n} for n in (11, 10))
    (words,) = warnings(Results(results.plans, [replace(first, row=many)]))
    assert words == (
        f"Diff\\_Light: 1 run with more than 1 % of the vehicles outside (`{first.spec.name}`)"
    )
    assert warnings(Results(results.plans, [replace(first, row=few)])) == []


def test_generalisation_is_relative_to_the_tested_rate(results):
    cases = ["random 10 %", "random 50 %"]
    trained = {"random 10 %": "rate 10", "random 50 %": "rate 50"}
    matrix = _generalisation(results, "jinan_1", cases, trained, "att_all")
    np.testing.assert_allclose(
        matrix, [[1, (310 + 50 + 3) / (305 + 10 + 3)], [(305 + 2 + 3) / (310 + 10 + 3), 1]]
    )


def of_bursts(run):
    """The run with bursts of another length in place of random missing."""
    missing = run.spec.settings.missing
    if missing.pattern != "random":
        return run
    bursts = missing.model_copy(update={"pattern": "burst", "mean_outage": 4.0})
    changes = {"settings": run.spec.settings.model_copy(update={"missing": bursts})}
    for key in ("case", "trained"):
        old = getattr(run.spec, key)
        changes[key] = old and f"{old.replace('random', 'burst')}, outages of 4 steps"
    return replace(run, spec=run.spec.model_copy(update=changes))


def test_generalisation_is_labelled_by_rates(results):
    def ticks(found):
        figure, words = generalisation_figure(found, "att_all")
        assert words == ""
        panel = figure.axes[0]
        axes = (panel.get_xticklabels(), panel.get_yticklabels())
        return [[text.get_text() for text in axis] for axis in axes]

    assert ticks(results) == [["10", "50"]] * 2
    assert ticks(Results(results.plans, map(of_bursts, results.runs))) == [["10", "50"]] * 2


def test_weights_that_were_trained_on_one_case_do_not_replace_each_other(results):
    def renamed(run):
        return replace(run, spec=run.spec.model_copy(update={"method": f"{run.spec.method}, more"}))

    more = [renamed(run) for run in results.runs if run.spec.trained == "random 10 %"]
    both = Results(results.plans, [*results.runs, *more])
    figure, words = generalisation_figure(both, "att_all")
    assert words.endswith("the first are shown, and not rate 10, more.")
    alone, _ = generalisation_figure(results, "att_all")
    np.testing.assert_array_equal(*(f.axes[0].images[0].get_array() for f in (figure, alone)))


def test_maps_are_of_blind_intersections(results):
    (run,) = map_runs(results, "att_all")
    assert run.spec.name == "jinan_1-kriging-0.25-Diff_Light-seed0"


def test_no_two_methods_look_alike():
    names = [f"method {k}" for k in range(40)]
    assert len(set(looks(names, names).values())) == 40
    assert len(set(looks(names[:10], ()).values())) == 10
    few = looks(names, names[3:5])
    assert [name for name in names if few[name].colour != GREY] == names[3:5]
    assert few[names[3]].colour != few[names[4]].colour


def test_the_best_and_the_best_conventional_method_are_in_colour(results, monkeypatch):
    assert leading_methods(results, "att_all") == results.methods
    monkeypatch.setattr("tsc_missing.report.leading.COLOURS", COLOURS[:3])
    monkeypatch.setattr("tsc_missing.report.leading.MOST", 2)
    # delay_based has the smallest travel times but sees everything
    assert leading_methods(results, "att_all") == ("Diff_Light", "max-queue")
    monkeypatch.setattr("tsc_missing.report.leading.MOST", 1)
    assert leading_methods(results, "att_all") == ("max-queue",)


def test_queues_are_smoothed_over_five_minutes():
    time = 15.0 * np.arange(240)
    queue = 100 + 30 * np.sin(2 * np.pi * time / 75)  # a cycle of 75 s
    inner = smooth(time, queue)[10:-10]
    assert np.ptp(inner) < 5
    assert inner.mean() == pytest.approx(100, abs=0.5)
    assert smooth(time, 2 * time) == pytest.approx(2 * time, abs=2 * 150)
    assert smooth(time, 2 * time)[10:-10] == pytest.approx(2 * time[10:-10])
    assert smooth(np.zeros(1), np.ones(1)).tolist() == [1.0]


@given(st.lists(st.floats(0, 3), min_size=1, max_size=9))
def test_labels_of_lines_keep_apart_and_in_order(values):
    _, (axes,) = panels(1, 0)
    axes.set_ylim(0, 2)
    label_ends(axes, [End(1.0, value, f"m{k}", GREY) for k, value in enumerate(values)])
    shown = sorted(axes.texts, key=lambda text: text.xyann[1])
    places = np.array([text.xyann[1] for text in shown])
    assert places[-1] <= 1 + 1e-9
    assert (np.diff(places) > 0.04).all()
    order = [min(values[int(text.get_text().split()[0][1:])], 2.0) for text in shown]
    assert order == sorted(order)
    for text in shown:
        value = values[int(text.get_text().split()[0][1:])]
        assert ("↑" in text.get_text()) == (value > 2)


@pytest.mark.parametrize(
    ("text", "shown"), [("a|b", "a\\|b"), ("<b>", "&lt;b&gt;"), ("_x_", "\\_x\\_")]
)
def test_text_is_shown_as_it_is(text, shown):
    assert escaped(text) == shown


def test_signs():
    assert [signed(x) for x in (-0.04, 0.04, -1.25, 3)] == ["+0.0", "+0.0", "−1.2", "+3.0"]


class Sources(html.parser.HTMLParser):
    """What a page loads and which headings it has."""

    def __init__(self):
        super().__init__()
        self.sources = []

    def handle_starttag(self, tag, attrs):
        self.sources += [value for name, value in attrs if name in ("src", "href")]


def test_the_command_makes_a_report_and_replaces_it(command, tmp_path):
    out = make_batch(command.cwd / "b", tmp_path, decisions=True, skip="max-pressure-seed2")
    done = command("report", "b")
    assert done.returncode == 0, done.stderr
    assert done.stdout == "b/report/report.md\nb/report/report.html\nb/report/runs.csv\n"
    text = (out / "report" / "report.md").read_text()
    assert text.startswith("# Made \\| up\n\nOf <no> meaning.")
    assert "**4 of 60 runs not run:**" in text
    assert "(2 of 3)" in text
    assert "tsc-batch made-up.toml" in text
    assert "tsc-report b" in text
    figures = {path.stem for path in (out / "report" / "figures").iterdir()}
    wanted = {"missing-rate", "generalisation", "imputation", "queues"}
    assert figures == {*wanted, "map-jinan_1-kriging-0.25-Diff_Light-seed0"}
    assert set(re.findall(r"figures/([^)]*)\.png", text)) == figures
    page = (out / "report" / "report.html").read_text()
    found = Sources()
    found.feed(page)
    assert len(found.sources) == len(figures)
    for source in found.sources:
        kind, _, data = source.partition(";base64,")
        assert kind == "data:image/svg+xml"
        assert base64.b64decode(data).lstrip().startswith(b"<?xml")
    assert "<td" in page

    again = command("report", "b", "--metric", "att_approach")
    assert again.returncode == 0, again.stderr
    (out / "report" / "report.html").unlink()  # as results are committed
    assert command("report", "b").returncode == 0
    assert (out / "report" / "report.html").is_file()
    assert command("report", "b", "--metric", "att_approach").returncode == 0
    assert "`att_approach` (mean time on the roads" in (out / "report" / "report.md").read_text()
    assert sorted(p.name for p in out.iterdir()) == ["batch.json", "failures", "report", "runs"]


def test_the_runs_come_as_a_table_too(command, tmp_path):
    out = make_batch(command.cwd / "b", tmp_path, skip="max-pressure-seed2")
    assert command("report", "b").returncode == 0
    lines = [*csv.DictReader((out / "report" / "runs.csv").open(newline=""))]
    rows = [row for row in read_rows(out) if row["status"] == "finished"]
    assert [line["run"] for line in lines] == [row["run"] for row in rows]
    for line, row in zip(lines, rows, strict=True):
        names = ("dataset", "case", "method", "seed", "demand_vehicles", "gridlock")
        assert [line[name] for name in names] == [str(row[name]) for name in names]
        assert float(line["att_all"]) == pytest.approx(row["att_all"], abs=1e-4)
        assert line["trips.parquet_sha256"] == (row["trips.parquet_sha256"] or "")
    assert {line["mask_seed"] for line in lines} == {"0", "1", "2"}  # of the run's seed


def test_a_metric_that_is_0_has_no_ratios(command, tmp_path):
    make_batch(command.cwd / "b", tmp_path)
    done = command("report", "b", "--metric", "mean_queue")
    assert (done.returncode, done.stderr) == (0, "")
    text = (command.cwd / "b" / "report" / "report.md").read_text()
    assert "| max-queue | **0.0 ± 0.0** |" in text
    assert "+nan" not in text
    compared = text.partition("## Against the best")[2].partition("\n## ")[0]
    assert "| max-queue | base | base | base | base |" in compared
    assert "| max-pressure |" not in compared


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nothing"], ["results: nothing", "no folder of tsc-batch"]),
        (["b", "--metric", "att_al"], ["--metric", "did you mean att_all?"]),
        (["b", "--metric", "sim_s_per_wall_s"], ["--metric", "allowed: att_all, att_approach"]),
        (["b", "--out", "other"], ["--out", "something else is in it"]),
        (["b", "b"], ["results", "same method, case and seed"]),
    ],
)
def test_mistakes(command, tmp_path, arguments, words):
    make_batch(command.cwd / "b", tmp_path)
    (command.cwd / "other").mkdir()
    (command.cwd / "other" / "file").touch()
    before = sorted(command.cwd.rglob("*"))
    done = command("report", *arguments)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    for word in words:
        assert word in done.stderr
    assert sorted(command.cwd.rglob("*")) == before


def test_a_table_of_nothing_finished(tmp_path):
    out = make_batch(tmp_path / "b", tmp_path, skip="jinan")
    write_table(out)
    with pytest.raises(Exception, match="no run in it is finished"):
        read_results([out])


def test_runs_of_other_demands_are_not_compared(tmp_path):
    folder = make_batch(tmp_path / "b", tmp_path)
    path = folder / "runs" / "jinan_1-random-0.5-max-queue-seed1" / "run.json"
    record = json.loads(path.read_text())
    path.write_text(json.dumps({**record, "demand": "recorded"}))
    with pytest.raises(
        UserError, match=r"seed1 cannot be compared: demand is recorded; .* profile;"
    ):
        read_results([folder])
    path.write_text(json.dumps(record))
    (path.parent / "mask.npz").write_bytes(b"another")
    with pytest.raises(UserError, match="seed1 cannot be compared: mask is"):
        read_results([folder])


def test_tables_with_many_cases_have_a_row_for_each():
    header = ["method", *(f"case {k}" for k in range(12))]
    lines = _wide_or_long(header, [["a", *map(str, range(12))], ["b", *map(str, range(12, 24))]])
    assert lines[1] == "| case | a | b |"
    assert lines[3:-1] == [f"| case {k} | {k} | {12 + k} |" for k in range(12)]
    few = _wide_or_long(header[:4], [["a", "1", "2", "3"]])
    assert few[1] == "| method | case 0 | case 1 | case 2 |"


def test_runs_of_another_network_are_not_compared(tmp_path):
    folder = make_batch(tmp_path / "b", tmp_path)
    path = next((folder / "runs").glob("*max-queue-seed1")) / "run.json"
    record = json.loads(path.read_text())
    for name in ("net.net.xml", "demand: jinan_1.json"):
        other = {**record, "checksums": {**record["checksums"], name: "abc"}}
        path.write_text(json.dumps(other))
        with pytest.raises(UserError, match="'s file is abc"):
            read_results([folder])


def test_a_network_that_is_gone_has_no_maps(tmp_path, monkeypatch):
    folder = make_batch(tmp_path / "b", tmp_path, decisions=True)
    results = read_results([folder])

    def gone(*_):
        raise UserError("net", "jinan_1", "there is no such folder")

    monkeypatch.setattr("tsc_missing.report.scenes.find_scenario", gone)
    report = make_report(results, "att_all")
    assert not [picture for picture in report.pictures if picture.name.startswith("map")]
    assert "not here as it was when it was run: jinan\\_1" in report.markdown


def test_the_base_has_as_many_seeds_as_any(tmp_path):
    whole = read_results([make_batch(tmp_path / "b", tmp_path)])
    case = ("jinan_1", "random 50 %")
    best = best_conventional(whole, *case, "att_all")
    (tmp_path / "c").mkdir()
    few = make_batch(tmp_path / "c", tmp_path, skip=f"random-0.5-{best}-seed0")
    assert best_conventional(read_results([few]), *case, "att_all") != best


def test_small_values_have_digits(results):
    lines = cells(result_table(results, "jinan_1", "decision_ms_median"))
    assert lines["max-queue"]["none"].startswith("**1.50")


def test_long_names_fit_beside_lines():
    assert shortened("max-queue") == "max-queue"
    words = shortened("/home/somebody/with/a/long/path/to/mine.py:LongestWait")
    assert len(words) == LONGEST
    assert words.startswith("/home")
    assert words.endswith("mine.py:LongestWait")


def test_actuated_signals_whose_detectors_fail_are_ranked(results):
    failing = {"controller": "actuated-recall"}
    changed = with_settings(results, lambda s: failing if s.method == "delay_based" else {})
    assert changed.references == ()
    assert best_conventional(changed, "jinan_1", "random 50 %", "att_all") == "delay_based"
    assert "delay\\_based°" not in make_report(changed, "att_all").markdown


def test_own_imputers_are_no_base(results):
    def with_own(run):
        if run.spec.method != "max-queue":
            return run
        settings = run.spec.settings.model_copy(update={"imputer": "mine.py:Mine"})
        return replace(run, spec=run.spec.model_copy(update={"settings": settings}))

    changed = Results(results.plans, map(with_own, results.runs))
    assert changed.kinds["max-queue"] == "own"
    assert best_conventional(changed, "jinan_1", "none", "att_all") == "max-pressure"
