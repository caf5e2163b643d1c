"""Every vehicle is accounted for: our sums against SUMO's own statistics and against the trips."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.cityflow_files import flow, grid_roadnet, road, write
from tsc_missing.config import RunSettings, VehicleType
from tsc_missing.evaluation.closed_loop import run_closed_loop
from tsc_missing.evaluation.metrics import gridlocked, read_outputs, summarise
from tsc_missing.evaluation.run import Options, execute, prepare
from tsc_missing.network.importing import import_cityflow
from tsc_missing.simulation.outputs import OutputFiles, TripTimes, read_lanes, read_totals

HORIZON = 300


def crowded(folder: Path) -> Path:
    """One intersection with more demand than can enter, so that some vehicles never do."""
    flows = [
        flow([road(0, 1, 0), road(1, 1, 0)], 0, 299, 1.0),
        flow([road(1, 0, 1), road(1, 1, 1)], 0, 299, 3.0),
        flow([road(2, 1, 2), road(1, 1, 3)], 0, 299, 7.0),
    ]
    paths = write(folder, grid_roadnet(1, 1), flows)
    import_cityflow(*paths, folder / "crowded", "crowded", HORIZON)
    return folder / "crowded"


@pytest.fixture(scope="module")
def crowded_run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("crowded")
    settings = RunSettings(net=str(crowded(folder)), horizon=HORIZON)
    prepared = prepare(settings, Options())
    outputs = OutputFiles(folder / "sumo")
    outputs.folder.mkdir()
    trace = run_closed_loop(prepared.scene, settings, prepared.controller, outputs.folder)
    measured = read_outputs(prepared.scene, outputs)
    result = summarise(prepared.scene, trace, measured, HORIZON, 0)
    return prepared.scene, outputs, result, measured.trips


def test_sums_agree_with_sumos_statistics_to_the_second(crowded_run):
    _, outputs, result, trips = crowded_run
    totals = read_totals(outputs.statistics)
    assert totals.vehicles == result.inserted
    ours = trips.travel_time(HORIZON)[trips.inserted] - trips.depart_delay(HORIZON)[trips.inserted]
    assert ours.sum() == pytest.approx(totals.travel_time, abs=1.0)
    assert trips.depart_delay(HORIZON).sum() == pytest.approx(totals.depart_delay, abs=1.0)
    whole = totals.travel_time + totals.depart_delay
    assert result.att_all * result.demand == pytest.approx(whole, abs=1.0)


def test_every_scheduled_vehicle_counts(crowded_run):
    scene, _, result, trips = crowded_run
    assert result.demand == len(scene.demand.trips) == 300 + 100 + 43
    assert result.never_inserted > 0
    assert result.inserted + result.never_inserted == result.demand
    assert result.finished < result.inserted
    assert np.isfinite(trips.travel_time(HORIZON)).all()
    assert (trips.depart_delay(HORIZON) >= 0).all()


def test_time_on_approaches_is_within_the_time_driven(crowded_run):
    scene, outputs, result, _ = crowded_run
    on_approach = read_lanes(outputs.lanes, scene.network.entrance_lanes).seconds.sum()
    totals = read_totals(outputs.statistics)
    assert 0 < on_approach < totals.travel_time
    assert result.att_approach == pytest.approx(on_approach / result.inserted)


def test_trips_parquet_has_the_same_sums(small_net, tmp_path):
    settings = RunSettings(net=str(small_net), horizon=450, controller="fixed-time-15")
    result = execute(prepare(settings, Options(out=tmp_path / "run")))
    table = pq.read_table(tmp_path / "run" / "trips.parquet").to_pydict()
    assert np.mean(table["travel_time"]) == pytest.approx(result.att_all)
    assert table["status"].count("finished") == result.finished
    assert table["depart"].count(None) == result.never_inserted
    assert table["vehicle"] == list(range(result.demand))
    run = json.loads((tmp_path / "run" / "run.json").read_text())
    assert run["result"]["att_all"] == result.att_all


def test_free_flow_time_of_a_lone_vehicle(tmp_path):
    """1170 m at 11.111 m/s, every light green: nothing but the road's length counts."""
    route = [road(0, 1, 0), road(1, 1, 0)]
    paths = write(tmp_path, grid_roadnet(1, 1, (600, 600)), [flow(route, 5)])
    import_cityflow(*paths, tmp_path / "net", "net", 300)
    settings = RunSettings(net=str(tmp_path / "net"), horizon=300, controller="max-queue")
    result = execute(prepare(settings, Options()))
    length = 2 * 585 + 30 - VehicleType().length
    assert result.att_all == pytest.approx(length / 11.111, abs=3)


def test_a_red_light_makes_a_queue_and_a_green_one_clears_it(tmp_path):
    """A stream meets 4 x 30 s phases: it waits for its phase and then leaves."""
    route = [road(1, 0, 1), road(1, 1, 1)]
    paths = write(tmp_path, grid_roadnet(1, 1), [flow(route, 0, 20, 4.0)])
    import_cityflow(*paths, tmp_path / "net", "net", 300)
    settings = RunSettings(net=str(tmp_path / "net"), horizon=120, controller="fixed-time-30")
    prepared = prepare(settings, Options())
    trace = run_closed_loop(prepared.scene, settings, prepared.controller, tmp_path)
    queue = trace.truth[:, 0, :, 1].sum(axis=1)  # phase 1, north and south, runs from 30 s on
    assert queue[2] > 0
    assert queue[4] == 0
    trips = read_outputs(prepared.scene, OutputFiles(tmp_path)).trips
    assert ((trips.stops > 0) == (trips.waiting_time > 0)).all()
    assert 0 < trips.stops.sum() < len(trips.stops)


def times(depart, arrival):
    depart, arrival = np.array(depart, dtype=float), np.array(arrival, dtype=float)
    nothing = np.zeros(len(depart))
    return TripTimes(nothing, depart, arrival, nothing, nothing, nothing, nothing)


@pytest.mark.parametrize(
    ("arrivals_in_window", "expected"), [(0, True), (9, True), (10, False), (100, False)]
)
def test_gridlock_is_fewer_arrivals_than_a_tenth_of_those_there(arrivals_in_window, expected):
    arrival = [3100.0] * arrivals_in_window + [np.nan] * (100 - arrivals_in_window)
    assert gridlocked(times([100.0] * 100, arrival), 3600.0) is expected


def test_an_empty_network_is_not_gridlocked():
    assert not gridlocked(times([100.0], [200.0]), 3600.0)
    assert not gridlocked(times([100.0], [np.nan]), 300.0)
