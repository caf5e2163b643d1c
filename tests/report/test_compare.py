"""Run folders beside each other: places, changes, files and what is refused."""

import csv
import json
import math
import shutil

import pyarrow.parquet as pq
import pytest

from tests.cityflow_files import grid_flows, grid_roadnet, write
from tsc_missing.config import MissingSettings, RunSettings
from tsc_missing.errors import UserError
from tsc_missing.evaluation.run import Options, execute, prepare
from tsc_missing.network.importing import import_cityflow
from tsc_missing.report.compare import compare, difference
from tsc_missing.report.compare_files import as_json, check_csv_path, write_csv
from tsc_missing.report.delay_map import delay_map
from tsc_missing.report.places import level_of_service


def run(folder, net, **settings):
    chosen = RunSettings(net=str(net), **{"horizon": 300, "controller": "max-queue", **settings})
    execute(prepare(chosen, Options(out=folder)))
    return folder


@pytest.fixture(scope="module")
def runs(small_net, tmp_path_factory):
    """One with everything, one with two of six intersections blind, one of fixed cycles."""
    folder = tmp_path_factory.mktemp("runs")
    blind = MissingSettings(pattern="kriging", rate=0.34)
    return (
        run(folder / "whole", small_net),
        run(folder / "blind", small_net, missing=blind),
        run(folder / "fixed", small_net, controller="fixed-time-30"),
    )


def refusal(*folders, each="intersection"):
    with pytest.raises(UserError) as caught:
        compare(folders, each)
    words = str(caught.value)
    assert words.startswith("run: ")
    assert "\n" not in words
    return words


def test_intersections_are_the_sums_of_their_movements(runs):
    table = pq.read_table(runs[0] / "movements.parquet").to_pylist()
    comparison = compare(runs[:1], "intersection")
    assert len(comparison.changes) == 6
    for (place,) in (change.places for change in comparison.changes):
        rows = [row for row in table if row["intersection"] == place.intersection]
        vehicles = sum(row["vehicles"] for row in rows)
        delay = sum(row["delay"] * row["vehicles"] for row in rows if row["vehicles"])
        assert place.served == sum(row["served"] for row in rows)
        assert place.delay == pytest.approx(delay / vehicles)
        assert place.level_of_service == level_of_service(delay / vehicles)
        assert place.longest_wait == max(row["longest_wait"] for row in rows)
        assert place.mean_queue == pytest.approx(sum(row["mean_queue"] for row in rows))


def test_one_run_has_its_intersections_worst_first(runs):
    comparison = compare(runs[:1], "intersection")
    delays = [change.places[0].delay for change in comparison.changes]
    assert delays == sorted(delays, reverse=True)
    assert comparison.most_changed(2) == comparison.changes[:2]
    assert comparison.differing == {}


def test_two_runs_are_the_most_changed_worst_first(runs):
    comparison = compare(runs[:2], "intersection")
    assert set(comparison.differing) == {"missing.pattern", "missing.rate"}
    assert comparison.warnings == []
    changes = [change.largest for change in comparison.changes]
    assert changes == sorted(changes, reverse=True)
    chosen = [change.largest for change in comparison.most_changed(3)]
    assert chosen == sorted(chosen, reverse=True)
    assert sorted(map(abs, chosen)) == sorted(map(abs, changes))[3:]
    assert sum(change.places[1].observed == 0 for change in comparison.changes) == 2


def test_the_json_object_has_all_of_it(runs):
    found = json.loads(json.dumps(as_json(compare(runs[:2], "intersection"))))
    whole = [json.loads((folder / "run.json").read_text()) for folder in runs[:2]]
    assert [it["result"] for it in found["runs"]] == [it["result"] for it in whole]
    assert [it["settings"] for it in found["runs"]] == [it["settings"] for it in whole]
    base, other = (it["result"]["att_all"] for it in whole)
    change = found["result_changes"][0]["att_all"]
    assert change["difference"] == pytest.approx(other - base)
    assert change["percent"] == pytest.approx(100 * (other - base) / base)
    assert len(found["places"]) == 6
    assert found["places"][0].keys() == {"intersection", "runs", "delay_changes"}


def test_three_runs_of_movements_as_csv(runs, tmp_path):
    write_csv(compare(runs, "movement"), tmp_path / "by.csv", "csv")
    with (tmp_path / "by.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 72
    assert {row["movement"] for row in rows} >= {"N-left", "W-right"}
    for row in rows:
        for number in (2, 3):
            change = row[f"delay_change_{number}"]
            ends = row["delay_1"], row[f"delay_{number}"]
            assert (change == "") == ("" in ends)
            if change:
                assert float(change) == pytest.approx(float(ends[1]) - float(ends[0]), abs=2e-4)


def test_other_demand_and_horizon_are_told(runs, small_net, tmp_path):
    short = run(tmp_path / "short", small_net, horizon=150)
    (warning,) = compare([*runs[:2], short], "intersection").warnings
    assert warning.startswith("runs 1 and 3 differ in horizon (300, 150): ")
    assert "not the controllers' alone" in warning


def test_another_seed_is_told_as_vehicles_may_drive_by_it(runs, tmp_path):
    told = ["runs 1 and 2 differ in seed (0, 1)"]
    for kind in ("recorded", "profile"):
        folders = [shutil.copytree(runs[0], tmp_path / f"{kind}-{seed}") for seed in (0, 1)]
        for seed, folder in enumerate(folders):
            file = json.loads((folder / "run.json").read_text())
            file |= {"demand": kind, "settings": {**file["settings"], "seed": seed}}
            (folder / "run.json").write_text(json.dumps(file))
        comparison = compare(folders, "intersection")
        assert list(comparison.differing) == ["seed"]
        assert [warning.partition(": ")[0] for warning in comparison.warnings] == told


def test_runs_of_other_intersections_are_refused(runs, tmp_path):
    paths = write(tmp_path, grid_roadnet(1, 2), grid_flows(1, 2))
    import_cityflow(*paths, tmp_path / "other", "other", 600)
    other = run(tmp_path / "other-run", tmp_path / "other", horizon=60)
    words = refusal(runs[0], other)
    assert f"{other} is of another network than {runs[0]}" in words
    assert f"only {runs[0]} has intersection_1_2" in words


def test_what_is_no_run_of_this_version_is_refused(runs, tmp_path):
    old = shutil.copytree(runs[0], tmp_path / "old")
    (old / "movements.parquet").unlink()
    words = refusal(runs[0], old)
    assert f"{old} is not allowed; it has no movements.parquet" in words
    assert "run it again" in words
    (old / "movements.parquet").write_bytes(b"PAR1 cut off")
    assert "cannot be read, so run it again" in refusal(old)
    shutil.copy(runs[0] / "trips.parquet", old / "movements.parquet")
    assert "cannot be read, so run it again" in refusal(old)
    (old / "run.json").write_text('{"settings": {}}')
    assert "run.json is not allowed; at settings.net" in refusal(old)
    (old / "run.json").write_text("{")
    assert "not valid JSON" in refusal(old)
    (old / "run.json").unlink()
    assert "it has no run.json, so it is no run folder" in refusal(old)


@pytest.mark.parametrize("count", [1, 2])
def test_the_map_marks_blind_intersections_and_names_all(runs, count):
    figure = delay_map(compare(runs[2 - count : 2], "intersection"), "picture")
    (axes,) = (axes for axes in figure.axes if axes.get_label() == "map")
    marks = {it.get_gid(): len(it.get_offsets()) for it in axes.collections if it.get_gid()}
    assert (marks["observed"], marks["never-observed"]) == (4, 2)
    assert marks["never-observed-crosses"] == 2
    assert len([text for text in figure.texts if text.get_gid() == "name"]) == 6


def test_a_network_that_is_gone_cannot_be_drawn(runs, tmp_path):
    gone = shutil.copytree(runs[0], tmp_path / "gone")
    file = json.loads((gone / "run.json").read_text())
    file["settings"]["net"] = "/nowhere/net"
    (gone / "run.json").write_text(json.dumps(file))
    with pytest.raises(UserError, match="picture: /nowhere/net cannot be drawn"):
        delay_map(compare([gone], "intersection"), "picture")


def test_where_a_csv_cannot_go(tmp_path):
    with pytest.raises(UserError, match="there is no folder"):
        check_csv_path(tmp_path / "no" / "by.csv", "csv")
    with pytest.raises(UserError, match="it is a folder"):
        check_csv_path(tmp_path, "csv")
    with pytest.raises(UserError, match=r"must end in \.csv"):
        check_csv_path(tmp_path / "run.json", "csv")


@pytest.mark.parametrize(
    ("delay", "letter"),
    [(0, "A"), (10, "A"), (10.1, "B"), (20, "B"), (35, "C"), (55, "D"), (80, "E"), (81, "F")],
)
def test_level_of_service(delay, letter):
    assert level_of_service(delay) == letter
    assert level_of_service(None) is None
    assert level_of_service(math.inf) == "F"


def test_differences_that_there_are_not():
    assert difference(0, 2) == (2, None)
    assert difference(None, 2) == difference(2, None) == difference(False, True) == (None, None)
