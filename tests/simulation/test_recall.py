"""Detectors of actuated signals that fail: the greens that they prolong last to their maximum."""

import subprocess
from contextlib import contextmanager

import numpy as np
import pytest

from tsc_missing.config import SignalSettings
from tsc_missing.network.folder import read_folder
from tsc_missing.network.model import Network
from tsc_missing.network.netconvert import sumo_tool
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.network.sumo import compile_sumo, open_net
from tsc_missing.simulation.engine import Inputs, Simulation
from tsc_missing.simulation.native import MAX_GREEN, PROGRAM_ID, RECALL
from tsc_missing.simulation.programs import NativeProgram
from tsc_missing.simulation.recall import MaximumRecall, _loops

SIGNALS = SignalSettings(yellow=3, min_green=8)


@contextmanager
def empty_roads(network, net, folder, signals=SIGNALS):
    """A simulation of the program without a vehicle."""
    (folder / "none.rou.xml").write_text("<routes/>")
    program = NativeProgram(RECALL, network)
    assert program.write(signals, folder / "signals.add.xml")
    inputs = Inputs(net, folder / "none.rou.xml", (folder / "signals.add.xml",))
    with Simulation(inputs) as simulation:
        program.start(simulation.api)
        yield simulation, program


def greens(simulation, program, begin, end):
    """The phase and the length [s] of each green of each intersection from ``begin`` to ``end``.

    Without those that are under way then.
    """
    shown = []
    for second in range(begin, end):
        simulation.advance(second + 1)
        shown.append(program.phases(simulation.api))
    found = []
    for phases in np.array(shown).T:
        starts = np.flatnonzero(np.diff(phases)) + 1
        lengths = np.diff(starts)
        kept = [(int(phases[s]), int(k)) for s, k in zip(starts, lengths, strict=False)]
        found.append([pair for pair in kept if pair[0] >= 0])
    return found


def lengths(found, phase):
    """Those of one phase."""
    return {length for of, length in found if of == phase}


@pytest.fixture
def grid(small_net):
    folder = read_folder(small_net, "small")
    return folder.network, folder.net_file


def test_a_silent_sensor_makes_its_green_as_long_as_can_be(grid, tmp_path):
    network, net = grid
    reported = np.ones((network.n, N_SLOTS), dtype=bool)
    slots = [slot for slot in range(N_SLOTS) if not network.free_slots[0, slot]][: network.n - 1]
    for n, slot in enumerate(slots):  # of one slot each, and the last has none
        reported[n, slot] = False
    with empty_roads(network, net, tmp_path) as (simulation, program):
        recall = MaximumRecall(network, simulation.api)
        recall.update(reported)
        found = greens(simulation, program, 0, 300)
        for n, slot in enumerate(slots):
            for phase in range(4):
                longest = network.phases[n, phase, slot]
                assert lengths(found[n], phase) == {MAX_GREEN if longest else 8}
        assert {length for _, length in found[-1]} == {8}
        recall.update(~reported)
        recall.update(np.ones_like(reported))
        greens(simulation, program, 300, 400)
        after = greens(simulation, program, 400, 600)
        assert {length for of_one in after for _, length in of_one} == {8}


def test_lanes_that_are_always_green_call_for_nothing(grid, tmp_path):
    network, net = grid
    assert network.free_slots.any()
    with empty_roads(network, net, tmp_path) as (simulation, program):
        MaximumRecall(network, simulation.api).update(~network.free_slots)
        found = greens(simulation, program, 0, 200)
        assert {length for of_one in found for _, length in of_one} == {8}


def test_a_blind_intersection_runs_a_cycle_of_the_longest_greens(grid, tmp_path):
    network, net = grid
    with empty_roads(network, net, tmp_path) as (simulation, program):
        MaximumRecall(network, simulation.api).update(~network.slot_mask)
        found = greens(simulation, program, 0, 300)
        assert {length for of_one in found for _, length in of_one} == {MAX_GREEN}


def test_greens_of_one_length_have_no_detectors(grid, tmp_path):
    network, net = grid
    fixed = SignalSettings(decision_interval=90, min_green=60)
    with empty_roads(network, net, tmp_path, fixed) as (simulation, _):
        assert simulation.api.inductionloop.getIDCount() == 0
        MaximumRecall(network, simulation.api).update(~network.slot_mask)


@pytest.fixture(scope="module")
def pockets(tmp_path_factory):
    """A grid with turning lanes so short that SUMO puts their detectors upstream, on one lane."""
    target = tmp_path_factory.mktemp("pockets") / "pockets.net.xml"
    options = ["--grid", "--grid.number=3", "--turn-lanes=1", "--turn-lanes.length=12"]
    more = ["--default-junction-type=traffic_light", "--grid.attach-length=100"]
    command = [sumo_tool("netgenerate"), *options, *more, "-o", str(target)]
    subprocess.run(command, check=True, capture_output=True)
    source = open_net(target)
    return Network("pockets", compile_sumo(source)), source.given


def test_every_detector_is_of_a_lane_also_where_it_lies_upstream(pockets, tmp_path):
    network, net = pockets
    with empty_roads(network, net, tmp_path) as (simulation, _):
        api = simulation.api
        pairs = [pair for name in network.ids for pair in _loops(name, api)]
        loops = dict(pairs)
        there = [name for name in api.inductionloop.getIDList() if f"_{PROGRAM_ID}_D" in name]
        assert sorted(loop for _, loop in pairs) == sorted(there)
        assert set(network.entrance_lanes) <= set(loops)
        places = {lane: api.inductionloop.getLaneID(loop) for lane, loop in loops.items()}
        upstream = {lane: at for lane, at in places.items() if at != lane}
        assert len(set(upstream.values())) < len(upstream)
        for lane, at in upstream.items():
            assert lane in {link[0] for link in api.lane.getLinks(at)}


def test_short_lanes_call_by_their_own_detectors(pockets, tmp_path):
    """One slot after the other: the greens that get longer are among those of its sensor."""
    network, net = pockets
    n = int(np.argmax(network.phase_mask.sum(axis=1)))
    prolonged = 0
    with empty_roads(network, net, tmp_path) as (simulation, program):
        recall = MaximumRecall(network, simulation.api)
        begin = 0
        for first in np.unique(network.slots_in_common[n][network.slot_mask[n]]):
            of_sensor = (network.slots_in_common[n] == first) & network.slot_mask[n]
            reported = np.ones((network.n, N_SLOTS), dtype=bool)
            reported[n, of_sensor] = False
            recall.update(reported)
            found = greens(simulation, program, begin + 200, begin + 700)
            begin += 700
            for phase, length in found[n]:
                green = network.phases[n, phase] | network.free_slots[n]
                assert length == 8 or (length == MAX_GREEN and green[of_sensor].any())
                prolonged += length == MAX_GREEN
            others = {length for m, of_one in enumerate(found) if m != n for _, length in of_one}
            assert others == {8}
    assert prolonged
