"""What became of each movement: sums against SUMO's own and the trips, and longest waits."""

import itertools
import subprocess
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tests.cityflow_files import flow, grid_flows, grid_roadnet, road, write
from tsc_missing.config import MissingSettings, RunSettings
from tsc_missing.demand.generate import DemandSpec
from tsc_missing.demand.trips import slots_of_turns
from tsc_missing.evaluation.closed_loop import run_closed_loop
from tsc_missing.evaluation.metrics import Measured, read_outputs
from tsc_missing.evaluation.movements import Movements, longest_waits, measure_movements
from tsc_missing.evaluation.run import Options, execute, prepare
from tsc_missing.evaluation.steps import Scene, Trace
from tsc_missing.network.importing import import_cityflow
from tsc_missing.network.importing_sumo import SumoImport, import_sumo
from tsc_missing.network.netconvert import sumo_tool
from tsc_missing.network.slots import N_SLOTS, slot_index
from tsc_missing.simulation.outputs import OutputFiles
from tsc_missing.simulation.programs import NativeProgram


@dataclass(frozen=True)
class Ran:
    scene: Scene
    trace: Trace
    measured: Measured
    movements: Movements
    lanes: dict[str, dict[str, str]]  # SUMO's own numbers

    def total(self, name: str, weight: dict[str, float]) -> float:
        return sum(
            part * float(self.lanes.get(lane, {}).get(name, 0)) for lane, part in weight.items()
        )


def ran(folder: Path, settings: RunSettings) -> Ran:
    prepared = prepare(settings, Options())
    outputs = OutputFiles(folder / "sumo")
    outputs.folder.mkdir()
    trace = run_closed_loop(prepared.scene, settings, prepared.controller, outputs.folder)
    measured = read_outputs(prepared.scene, outputs)
    native = isinstance(prepared.controller, NativeProgram)
    found = measure_movements(prepared.scene, trace, measured, settings.horizon, native)
    lanes = {lane.get("id"): lane.attrib for lane in ElementTree.parse(outputs.lanes).iter("lane")}
    return Ran(prepared.scene, trace, measured, found, lanes)


def passed(scene: Scene) -> Counter[int]:
    """How many trips go over each flat slot."""
    slot_of = slots_of_turns(scene.network)
    pairs = (pair for trip in scene.demand.trips for pair in itertools.pairwise(trip.route))
    return Counter(slot_of[pair] for pair in pairs if pair in slot_of)


@pytest.fixture(scope="module")
def grid(small_net, tmp_path_factory) -> Ran:
    """Two rows and three columns, stopped in the middle of the traffic."""
    missing = MissingSettings(pattern="kriging", rate=0.34)
    settings = RunSettings(net=str(small_net), horizon=450, controller="max-queue", missing=missing)
    return ran(tmp_path_factory.mktemp("grid"), settings)


def test_sums_are_sumos_own(grid):
    found, lanes = grid.movements, dict.fromkeys(grid.scene.network.entrance_lanes, 1.0)
    assert found.served.sum() == grid.total("left", lanes) > 0
    assert found.total_time_loss.sum() == pytest.approx(grid.total("timeLoss", lanes))
    assert found.total_waiting_time.sum() == pytest.approx(grid.total("waitingTime", lanes))
    entry = grid.measured.trips.depart_delay(450.0).sum()
    assert found.total_depart_delay.sum() == pytest.approx(entry)


def test_who_came_passed_or_is_still_there(grid):
    """Those inside at the end are on entrance lanes, on the last roads or in junctions."""
    trips, found = grid.measured.trips, grid.movements
    there = found.vehicles - found.served
    assert (there >= 0).all()
    assert there.sum() == grid.measured.lanes.there.sum() + (~trips.inserted).sum()
    assert 0 < there.sum() <= (~trips.finished).sum()
    queue = grid.trace.truth[..., 1]
    np.testing.assert_allclose(found.mean_queue, queue.mean(axis=0))
    assert found.longest_queue.max() == queue.max()


def test_blind_intersections_were_not_observed(grid):
    present = grid.scene.network.slot_mask
    observed = np.array(
        [set(row[there]) for row, there in zip(grid.movements.observed, present, strict=True)]
    )
    assert sorted(map(tuple, observed)) == [(0.0,)] * 2 + [(1.0,)] * 4


def test_vehicles_are_the_trips_through_where_all_arrive(tmp_path):
    paths = write(tmp_path, grid_roadnet(2, 3), grid_flows(2, 3, horizon=60))
    import_cityflow(*paths, tmp_path / "net", "net", 900)
    found = ran(
        tmp_path, RunSettings(net=str(tmp_path / "net"), horizon=900, controller="max-queue")
    )
    assert found.measured.trips.finished.all()
    expected = passed(found.scene)
    for flat, served in enumerate(found.movements.served.ravel()):
        assert served == expected[flat]
    np.testing.assert_array_equal(found.movements.served, found.movements.vehicles)


def test_waiting_to_enter_counts_for_the_movement_that_it_waits_for(tmp_path):
    """Twice as many want to go straight as can enter; those who turn left enter in time."""
    flows = [
        flow([road(0, 1, 0), road(1, 1, 0)], 0, 299, 0.5),
        flow([road(1, 0, 1), road(1, 1, 2)], 0, 299, 60.0),
    ]
    import_cityflow(*write(tmp_path, grid_roadnet(1, 1), flows), tmp_path / "net", "net", 300)
    settings = RunSettings(net=str(tmp_path / "net"), horizon=300, controller="fixed-time-30")
    found = ran(tmp_path, settings)
    straight, left = slot_index(3, 1), slot_index(2, 0)
    delays, outside = found.movements.columns(), (~found.measured.trips.inserted).sum()
    assert outside > 100
    assert delays["depart_delay"][0, straight] > 60 > 1 > delays["depart_delay"][0, left]
    whole = found.measured.trips.depart_delay(300.0)
    assert found.movements.total_depart_delay[0, straight] == pytest.approx(
        sum(
            w
            for w, trip in zip(whole, found.scene.demand.trips, strict=True)
            if trip.route[0] == road(0, 1, 0)
        )
    )
    there = found.lanes["road_0_1_0_1"]
    still = float(there["departed"]) - float(there["left"])
    assert found.movements.vehicles[0, straight] == float(there["left"]) + still + outside
    assert np.isnan(delays["delay"][0, slot_index(0, 0)])  # nobody came
    np.testing.assert_allclose(delays["delay"], delays["time_loss"] + delays["depart_delay"])


def test_lanes_count_in_parts_where_movements_share_them(tmp_path):
    """Of short lanes too, whose sensors reach to the lanes upstream."""
    options = ["--grid", "--grid.number=3", "--turn-lanes=1", "--default.lanenumber=2"]
    more = ["--default-junction-type=traffic_light", "--random-lanenumber", "--random-priority"]
    path = tmp_path / "pockets.net.xml"
    command = [sumo_tool("netgenerate"), *options, *more, "-o", str(path)]
    subprocess.run(command, check=True, capture_output=True)
    demand = DemandSpec(vehicles_per_hour=1500)
    import_sumo(SumoImport(path, demand=demand), tmp_path / "net", "net")
    found = ran(
        tmp_path, RunSettings(net=str(tmp_path / "net"), horizon=300, controller="fixed-time")
    )
    network, movements = found.scene.network, found.movements
    places, _, weight = network.sensor_slots
    parts = np.bincount(places, weight, minlength=len(network.sensor_lanes))
    sensors = dict(zip(network.sensor_lanes, parts, strict=True))
    entrances = dict.fromkeys(network.entrance_lanes, 1.0)
    assert network.shares_lanes.any()
    assert len(sensors) > len(entrances)
    assert movements.served.sum() == pytest.approx(found.total("left", entrances))
    assert movements.total_time_loss.sum() == pytest.approx(found.total("timeLoss", sensors))
    for n in range(network.n):
        own = {lane: 1.0 for lanes in network.slot_lanes[n] for lane in lanes}
        assert movements.served[n].sum() == pytest.approx(found.total("left", own))
    assert not movements.served[~network.slot_mask].any()


@pytest.mark.parametrize("controller", ["fixed-time-30", "actuated"])
def test_the_file_has_a_row_a_movement(small_net, tmp_path, controller):
    settings = RunSettings(net=str(small_net), horizon=300, controller=controller)
    prepared = prepare(settings, Options(out=tmp_path / "run"))
    execute(prepared)
    network = prepared.scene.network
    table = pq.read_table(tmp_path / "run" / "movements.parquet").to_pydict()
    assert len(table["movement"]) == network.slot_mask.sum() == 6 * N_SLOTS
    assert list(dict.fromkeys(table["intersection"])) == list(network.ids)
    assert table["movement"][:3] == ["N-left", "N-straight", "N-right"]
    waits = table["longest_wait"]
    if controller == "actuated":  # whose greens are not all seen
        assert set(waits) == {None}
    else:
        assert max(waits) <= 300
        assert {w for w, name in zip(waits, table["movement"], strict=True) if "right" in name} == {
            0
        }
        assert 30 <= max(waits) <= 90 + 15  # a cycle of four phases of 30 s


def brute(queued, green, lasted):
    best = 0.0
    for start in range(len(queued)):
        for end in range(start + 1, len(queued) + 1):
            if all(queued[t] and not green[t] for t in range(start, end)):
                best = max(best, sum(lasted[start:end]))
    return best


@given(st.data(), st.integers(1, 12))
def test_longest_waits_are_those_found_by_trying_all(data, steps):
    shape = (steps, 2, 3)
    queued = data.draw(arrays(bool, shape))
    green = data.draw(arrays(bool, shape))
    lasted = data.draw(arrays(float, steps, elements=st.sampled_from([5.0, 15.0])))
    found = longest_waits(queued, green, lasted)
    for place in np.ndindex(2, 3):
        expected = brute(queued[(slice(None), *place)], green[(slice(None), *place)], lasted)
        assert found[place] == expected
