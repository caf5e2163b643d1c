"""Sensors over several lanes count a vehicle once."""

import subprocess
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.sumo_files import star
from tsc_missing.config import SensorSettings
from tsc_missing.network.model import Network
from tsc_missing.network.netconvert import sumo_tool
from tsc_missing.network.sumo import compile_sumo, open_net
from tsc_missing.sensing.observation import QUEUE, VEHICLES
from tsc_missing.simulation.detectors import Detectors, _area, covered_lanes, write_area_detectors
from tsc_missing.simulation.engine import Inputs, Simulation

SENSOR = SensorSettings(kind="area", length=150.0)


@pytest.fixture
def cut(tmp_path):
    """A crossing whose roads are cut in two, 60 m before it, with vehicles that queue there."""
    path = star(tmp_path, (0, 90, 180, 270), 2)
    splits = "".join(f'<edge id="in_{k}"><split pos="-60"/></edge>' for k in range(4))
    (tmp_path / "cut.edg.xml").write_text(f"<edges>{splits}</edges>")
    words = ["-s", path.name, "-e", "cut.edg.xml", "-o", "cut.net.xml"]
    command = [sumo_tool("netconvert"), *words, "--no-internal-links"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    source = open_net(tmp_path / "cut.net.xml")
    network = Network("cut", compile_sumo(source))
    assert len(covered_lanes(network, SENSOR.length)) > len(network.entrance_lanes)
    flows = "".join(
        f'<flow id="{k}" begin="0" end="300" period="3" from="in_{k}" to="out_{(k + 2) % 4}" '
        'departLane="best" departSpeed="max"/>'
        for k in range(4)
    )
    routes = tmp_path / "cars.rou.xml"
    routes.write_text(f'<routes><vType id="car" sigma="0"/>{flows}</routes>')
    areas = tmp_path / "areas.add.xml"
    write_area_detectors(network, SENSOR.length, areas)
    return network, Inputs(source.given, routes, (areas,))


@given(end=st.floats(0.1, 500), covered=st.floats(0.01, 500))
def test_positions_are_within_the_lane(end, covered):
    element = ElementTree.fromstring(_area("a", "l", max(end - covered, 0.0), end))
    first, last = float(element.get("pos")), float(element.get("endPos"))
    assert 0 <= first < last <= end
    assert last == pytest.approx(end, abs=0.01)
    assert first == pytest.approx(max(end - covered, 0.0), abs=0.02)


@pytest.mark.parametrize("engine", ["libsumo", "traci"])
def test_a_vehicle_across_two_lanes_counts_once(cut, engine):
    network, inputs = cut
    across = 0
    with Simulation(inputs, engine=engine) as simulation:
        api = simulation.api
        detectors = Detectors(network, SENSOR, api)
        for time in range(5, 240, 5):
            simulation.advance(time)
            there = [api.lanearea.getLastStepVehicleIDs(lane) for lane in network.sensor_lanes]
            ids = {name for names in there for name in names}
            across += sum(map(len, there)) - len(ids)
            values = detectors.read().values
            assert values[..., VEHICLES].sum() == pytest.approx(len(ids))
            slow = [name for name in ids if api.vehicle.getSpeed(name) < 0.1]
            assert values[..., QUEUE].sum() == pytest.approx(len(slow))
    assert across > 0
    assert np.isfinite(values).all()
