"""SUMO nets become networks whose phases follow from the junction's own conflicts."""

import subprocess
from xml.etree import ElementTree

import numpy as np
import pytest

from tests.sumo_files import star
from tsc_missing.config import MissingSettings
from tsc_missing.errors import UserError
from tsc_missing.network.grid import GridSpec, build_grid
from tsc_missing.network.importing_sumo import _copy_net
from tsc_missing.network.model import Network
from tsc_missing.network.netconvert import sumo_tool, write_net
from tsc_missing.network.slots import LEFT, N_SLOTS, RIGHT, TURNS, slot_name
from tsc_missing.network.sumo import compile_sumo, open_net, yellow_for
from tsc_missing.network.sumo_files import find_files, read_additional, write_programs
from tsc_missing.sensing.outage_list import read_outages
from tsc_missing.sensing.patterns import draw_mask
from tsc_missing.simulation.detectors import covered_lanes
from tsc_missing.simulation.states import check_state, green_state, sumo_state

CROSS = (0, 90, 180, 270)


def read(path, **options):
    source = open_net(path)
    return source, Network("star", compile_sumo(source, **options))


def slots(table):
    return {slot_name(int(slot)) for slot in np.flatnonzero(table)}


def assert_sound(network):
    """Every phase is legal and of its own, and every movement has one or is always green."""
    for n, node in enumerate(network.intersections):
        for phase in range(len(node.phases)):
            check_state(node, green_state(node, phase))
        tables = {tuple(table) for table in network.phases[n, : len(node.phases)].tolist()}
        assert len(tables) == len(node.phases)
        served = network.phases[n].any(axis=0) | network.free_slots[n]
        assert (served == network.slot_mask[n]).all()
        links = {k for phase in node.phases for k in phase.links} | set(node.free)
        assert links == set(range(len(node.links)))


def cross(folder):
    """A cross with a lane for each turn."""
    spec = GridSpec(rows=1, columns=1, east_west=200, north_south=200)
    write_net(build_grid(spec), folder / "cross.net.xml")
    return folder / "cross.net.xml"


def test_a_plain_cross_has_the_four_phases_of_the_literature(tmp_path):
    _, network = read(cross(tmp_path))
    assert network.ids == ("intersection_1_1",)
    assert_sound(network)
    assert network.slot_mask.all()
    expected = [
        {"N-straight", "S-straight"},
        {"E-straight", "W-straight"},
        {"N-left", "S-left"},
        {"E-left", "W-left"},
    ]
    found = [{s for s in slots(p) if "right" not in s} for p in network.phases[0]]
    assert sorted(map(sorted, found)) == sorted(map(sorted, expected))


def test_all_phases_are_the_eight_pairs(tmp_path):
    _, network = read(cross(tmp_path), all_phases=True)
    assert_sound(network)
    assert network.phase_mask.sum() == 8


def test_shared_lanes_are_green_together_and_left_turns_wait_for_gaps(tmp_path):
    _, network = read(star(tmp_path, CROSS, 1))
    assert_sound(network)
    assert network.phase_mask.sum() == 2
    node = network.intersections[0]
    for p, phase in enumerate(node.phases):
        assert len(slots(network.phases[0, p])) == 6
        state = green_state(node, p)
        for link in phase.links:
            left = node.links[link].slot % len(TURNS) == 0
            assert state[link] == "g" if left else state[link] in "Gg"


@pytest.mark.parametrize("bearings", [(0, 90, 180), (10, 130, 250), (30, 160, 275)])
@pytest.mark.parametrize("lanes", [1, 2, 3])
def test_three_arms(tmp_path, bearings, lanes):
    _, network = read(star(tmp_path, bearings, lanes))
    assert_sound(network)
    assert network.slot_mask.sum() == 6
    assert 2 <= network.phase_mask.sum() <= 3
    assert not network.phases[0][:, ~network.slot_mask[0]].any()


def test_five_arms_share_four_approaches(tmp_path):
    source, network = read(star(tmp_path, (0, 72, 144, 216, 288), 2))
    assert_sound(network)
    assert len(set(network.intersections[0].roads.values())) == 4
    assert any("more than four roads" in note for note in source.notes)


def test_offset_approaches_get_one_each(tmp_path):
    _, network = read(star(tmp_path, (40, 60, 200, 280), 2))
    assert_sound(network)
    assert sorted(network.intersections[0].roads.values()) == [0, 1, 2, 3]


def test_pedestrians_are_ignored_with_a_note(tmp_path):
    options = ("--crossings.guess", "--sidewalks.guess=false")
    source, network = read(star(tmp_path, CROSS, 2, options=options, sidewalk=True))
    assert_sound(network)
    assert any("pedestrians are ignored: 4 crossings" in note for note in source.notes)
    node = network.intersections[0]
    assert node.state_length == len(node.links) + 4
    assert sumo_state(node, green_state(node, 0)).endswith("rrrr")
    assert not any(lane.endswith("_0") for lane in network.record.lanes)  # the sidewalks


def test_signal_groups_keep_their_place_in_the_state(tmp_path):
    _, network = read(star(tmp_path, CROSS, 1, options=("--tls.group-signals",)))
    node = network.intersections[0]
    assert node.positions is not None
    assert node.state_length < len(node.links)
    for phase in range(len(node.phases)):
        shown = sumo_state(node, green_state(node, phase))
        assert len(shown) == node.state_length
        for link, place in enumerate(node.positions):
            assert (shown[place] == "r") == (green_state(node, phase)[link] == "r")


def test_one_signal_at_two_junctions(tmp_path):
    """Offset side roads: the road between the junctions goes with the main road."""
    nodes = {
        "w": (-200, 0),
        "a": (0, 0),
        "b": (40, 0),
        "e": (240, 0),
        "n": (0, 200),
        "s": (40, -200),
    }
    ends = [("w", "a"), ("a", "b"), ("b", "e"), ("n", "a"), ("s", "b")]
    light = ' type="traffic_light" tl="J"'
    lines = [
        f'<node id="{k}" x="{x}" y="{y}"{light if k in "ab" else ""}/>'
        for k, (x, y) in nodes.items()
    ]
    (tmp_path / "j.nod.xml").write_text(f"<nodes>{''.join(lines)}</nodes>")
    edges = [f'<edge id="{i}{j}" from="{i}" to="{j}"/>' for p in ends for i, j in (p, p[::-1])]
    (tmp_path / "j.edg.xml").write_text(f"<edges>{''.join(edges)}</edges>")
    command = [sumo_tool("netconvert"), "-n", "j.nod.xml", "-e", "j.edg.xml", "-o", "j.net.xml"]
    subprocess.run([*command, "--no-turnarounds"], cwd=tmp_path, check=True, capture_output=True)
    source, network = read(tmp_path / "j.net.xml")
    assert network.ids == ("J",)
    roads = network.intersections[0].roads
    assert (roads["ab"], roads["ba"]) == (roads["wa"], roads["eb"])
    assert len({roads[name] for name in ("wa", "eb", "na", "sb")}) == 4
    assert_sound(network)
    assert any("several junctions: J" in note for note in source.notes)


def test_lanes_without_a_signal_are_no_movements(tmp_path):
    """Right turns that bypass the signal: their slots are absent, and nothing waits for them."""
    path = cross(tmp_path)
    tree = ElementTree.parse(path)
    connections = [c for c in tree.iter("connection") if c.get("tl")]
    for connection in connections:
        if connection.get("dir") == "r":
            del connection.attrib["tl"], connection.attrib["linkIndex"]
    tree.write(path)
    _, network = read(path)
    assert_sound(network)
    assert {slot % len(TURNS) for slot in np.flatnonzero(network.slot_mask[0])} == {0, 1}
    node = network.intersections[0]
    assert node.state_length == len(connections)  # the places are still in SUMO's state


def test_left_hand_traffic_is_the_mirror_image(tmp_path):
    """Right turns cross the oncoming traffic, so from shared lanes they wait for gaps."""
    source, network = read(star(tmp_path, CROSS, 1, options=("--lefthand",)))
    assert_sound(network)
    assert network.record.left_hand
    assert any("left" in note for note in source.notes)
    assert network.phase_mask.sum() == 2
    node = network.intersections[0]
    for p, phase in enumerate(node.phases):
        state = green_state(node, p)
        waiting = {node.links[k].slot % len(TURNS) for k in phase.links if state[k] == "g"}
        assert waiting == {RIGHT}


@pytest.mark.parametrize("lanes", [1, 3])
def test_turning_back_on_the_left_is_the_mirror_image_too(tmp_path, lanes):
    """SUMO has another letter for it there."""
    found = []
    for options in ((), ("--lefthand",)):
        net = star(tmp_path, CROSS, lanes, options=options, turning_back=True)
        _, network = read(net)
        assert_sound(network)
        found.append(network.phases[0])
        across = LEFT if not options else RIGHT
        back = [link for link in network.intersections[0].links if link.to_lane == out_of(link)]
        assert len(back) == 4
        assert {link.slot % len(TURNS) for link in back} == {across}
    assert (found[0] == found[1]).all()


def out_of(link):
    """The innermost lane of the road back to where a star's link comes from."""
    return link.from_lane.replace("in", "out")


def test_turns_that_the_net_never_stops_are_always_green(tmp_path):
    path = cross(tmp_path)
    tree = ElementTree.parse(path)
    right = {
        int(c.get("linkIndex"))
        for c in tree.iter("connection")
        if c.get("dir") == "r" and c.get("tl")
    }
    for phase in tree.iter("phase"):
        state = phase.get("state")
        phase.set(
            "state", "".join("s" if k in right and a == "r" else a for k, a in enumerate(state))
        )
    tree.write(path)
    _, network = read(path)
    assert_sound(network)
    assert slots(network.free_slots[0]) == {f"{a}-right" for a in "NESW"}
    assert network.phase_mask.sum() == 4


def test_only_the_signals_that_are_named(tmp_path):
    path = grid_net(tmp_path)
    source, network = read(path, chosen=["A0"])
    assert network.ids == ("A0",)
    assert any("3 other signals" in note for note in source.notes)
    with pytest.raises(UserError, match=r"signals: A9 .*did you mean A"):
        compile_sumo(open_net(path), ["A9"])


def grid_net(folder):
    target = folder / "grid.net.xml"
    options = ["--grid", "--grid.number=2", "--grid.attach-length=150", "--grid.length=200"]
    more = ["--default-junction-type=traffic_light", "--no-turnarounds", "-o", str(target)]
    command = [sumo_tool("netgenerate"), *options, *more, "--default.lanenumber=2"]
    subprocess.run(command, check=True, capture_output=True)
    return target


def test_neighbours_are_found_through_junctions_without_signals(tmp_path):
    """A road that is cut by a plain node counts as one; short lanes are sensed beyond the node."""
    path = grid_net(tmp_path)
    _, whole = read(path)
    cut = tmp_path / "cut.net.xml"
    (tmp_path / "cut.edg.xml").write_text(
        '<edges><edge id="A0B0"><split pos="160"/></edge></edges>'
    )
    command = [sumo_tool("netconvert"), "-s", str(path), "-e", str(tmp_path / "cut.edg.xml")]
    subprocess.run([*command, "-o", str(cut)], check=True, capture_output=True)
    _, network = read(cut)
    assert (network.neighbours == whole.neighbours).all()
    assert (network.adjacency == whole.adjacency).all()
    own = [set(lanes) - set(network.entrance_lanes) for lanes in network.boundary_lanes]
    before = [set(lanes) for lanes in whole.boundary_lanes]
    more = {lane for now, then in zip(own, before, strict=True) for lane in now - then}
    assert more == {"A0B0_0", "A0B0_1"}
    assert whole.record.reach is None
    assert network.record.reach
    lanes = network.record.lanes
    for name, parts in network.record.reach.items():
        assert lanes[name].length < 100
        assert [part.lane for part in parts] == [f"A0B0_{name[-1]}"]
        assert parts[0].distance == pytest.approx(lanes[name].length, abs=0.01)
    places, flat, weight = network.sensor_slots
    assert len(network.sensor_lanes) == len(network.entrance_lanes) + 2
    assert np.bincount(places, weight).max() <= 1 + 1e-9
    assert flat.max() < network.n * N_SLOTS
    short = max(parts[0].distance for parts in network.record.reach.values())
    assert covered_lanes(network, short / 2) == network.entrance_lanes
    assert covered_lanes(network, short + 1) == network.sensor_lanes


@pytest.fixture
def pockets(tmp_path):
    """Short turning lanes that part from common lanes, which their sensors cover too."""
    target = tmp_path / "pockets.net.xml"
    options = ["--grid", "--grid.number=3", "--turn-lanes=1", "--default.lanenumber=2"]
    more = ["--default-junction-type=traffic_light", "--random-lanenumber", "--random-priority"]
    command = [sumo_tool("netgenerate"), *options, *more, "-o", str(target)]
    subprocess.run(command, check=True, capture_output=True)
    return read(target)[1]


def assert_common_sensors_fail_together(network, mask):
    lanes, flat, _ = network.sensor_slots
    reports = mask.reshape(len(mask), -1)
    for lane in range(len(network.sensor_lanes)):
        of_lane = reports[:, flat[lanes == lane]]
        assert (of_lane == of_lane[:, :1]).all()


def test_slots_with_a_sensor_in_common_fail_together(pockets, tmp_path):
    """What is shared upstream of short lanes would tell of what is not seen."""
    lanes, _, _ = pockets.sensor_slots
    upstream = lanes >= len(pockets.entrance_lanes)
    assert (np.bincount(lanes[upstream]) > 1).any()
    assert not pockets.shares_lanes.all()
    for pattern in ("random", "lane", "mixed"):
        mask = draw_mask(MissingSettings(pattern=pattern, rate=0.4), pockets, 20, 3)
        assert not mask[:, pockets.slot_mask].all()
        assert_common_sensors_fail_together(pockets, mask)
    for n, slot in zip(*np.nonzero(pockets.slot_mask), strict=True):
        line = f"{pockets.ids[n]},{slot_name(int(slot))}"
        (tmp_path / "a.csv").write_text(f"intersection,slot\n{line}\n")
        mask = read_outages(tmp_path / "a.csv", pockets, 2, 15.0)
        assert not mask[:, n, slot].any()
        assert_common_sensors_fail_together(pockets, mask)


def test_a_lane_has_a_sensor_for_one_intersection(pockets):
    """Where two could see a lane, it is of the one with the nearer stop line."""
    parts = dict(pockets.record.reach)
    entrance, (part, *_) = next(iter(parts.items()))
    (home,) = {n for n, slots in enumerate(pockets.slot_lanes) if entrance in sum(slots, ())}
    other = sum(pockets.slot_lanes[home - 1], ())[0]
    for metres, owner in ((-1.0, (home - 1) % pockets.n), (1.0, home)):
        further = part.model_copy(update={"distance": part.distance + metres})
        reach = {**parts, other: (*parts.get(other, ()), further)}
        network = Network("it", pockets.record.model_copy(update={"reach": reach}))
        lanes, flat, _ = network.sensor_slots
        of_lane = flat[lanes == network.sensor_lanes.index(part.lane)]
        assert set(of_lane // N_SLOTS) == {owner}


def test_yellow_follows_from_the_speed():
    assert [yellow_for(v / 3.6) for v in (30, 40, 50, 70, 100)] == [3, 3, 4, 5, 6]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "cannot be read as a SUMO net"),
        ("<net", "cannot be read as a SUMO net"),
        ("no XML", "cannot be read as a SUMO net"),
        ("<routes/>", "SUMO net"),
    ],
)
def test_files_that_are_no_nets(tmp_path, content, words):
    path = tmp_path / "x.net.xml"
    path.write_text(content)
    with pytest.raises(UserError, match=words):
        open_net(path)


def test_nets_without_a_signal_to_control(tmp_path):
    with pytest.raises(UserError, match="no junction in it has traffic signals"):
        compile_sumo(open_net(star(tmp_path, CROSS, 1, kind="priority")))
    with pytest.raises(
        UserError, match=r"nothing to decide|anything to decide: c \(no conflicts\)"
    ):
        compile_sumo(open_net(star(tmp_path, (0, 180), 1)))


def split_in_two(path):
    """Give two roads of a star a signal of their own at the same junction, as SUMO allows."""
    light = {"in_0": "a", "in_1": "a", "in_2": "b", "in_3": "b"}
    tree = ElementTree.parse(path)
    counts = {"a": 0, "b": 0}
    for connection in tree.getroot().findall("connection[@tl]"):
        name = light[connection.get("from")]
        connection.set("tl", name)
        connection.set("linkIndex", str(counts[name]))
        counts[name] += 1
    (program,) = tree.getroot().findall("tlLogic")
    place = list(tree.getroot()).index(program)
    tree.getroot().remove(program)
    for name, count in counts.items():
        logic = ElementTree.Element("tlLogic", id=name, type="static", programID="0", offset="0")
        half = count // 2
        for state in ("G" * half + "r" * half, "r" * half + "G" * half):
            ElementTree.SubElement(logic, "phase", duration="40", state=state)
        tree.getroot().insert(place, logic)
    tree.write(path)
    return path


def test_signals_that_share_a_junction_are_left_alone(tmp_path):
    path = split_in_two(star(tmp_path, CROSS))
    with pytest.raises(UserError, match=r": a \(another signal at its junction\), b \(another"):
        read(path)
    with pytest.raises(UserError, match=r"signals: a .* another signal at its junction"):
        read(path, chosen=["a"])


def test_nothing_switches_between_programs(tmp_path):
    source, target = tmp_path / "a.net.xml", tmp_path / "b.net.xml"
    switch = '<WAUT refTime="0" id="w" startProg="0"/><wautJunction wautID="w" junctionID="c"/>'
    source.write_text(f'<net><tlLogic id="c"/>{switch}</net>')
    _copy_net(source, target)
    assert [element.tag for element in ElementTree.parse(target).getroot()] == ["tlLogic"]
    source.write_text('<net><tlLogic id="c"/></net>')
    _copy_net(source, target)
    assert target.read_text() == source.read_text()


def configured(tmp_path, options="", *elements):
    """A configuration with these options and an additional file with these elements."""
    star(tmp_path, CROSS, 1)
    (tmp_path / "more.add.xml").write_text(f"<additional>{''.join(elements)}</additional>")
    path = tmp_path / "all.sumocfg"
    path.write_text(
        '<configuration><net-file value="star.net.xml"/>'
        f'<additional-files value="more.add.xml"/>{options}</configuration>'
    )
    return path


def test_a_program_without_phases_only_shifts_that_of_the_net(tmp_path):
    shift = '<tlLogic id="c" programID="0" offset="10"/>'
    phases = '<tlLogic id="c" programID="own"><phase duration="9" state="GGGG"/></tlLogic>'
    found = read_additional(find_files(configured(tmp_path, "", shift)).additional)
    assert found.states == {}
    source = open_net(tmp_path / "star.net.xml", found.states)
    assert len(source.programs["c"]) > 1
    write_programs(found, tmp_path / "signals.add.xml")
    assert 'offset="10"' in (tmp_path / "signals.add.xml").read_text()
    found = read_additional(find_files(configured(tmp_path, "", phases, shift)).additional)
    assert found.states == {"c": ["GGGG"]}
    assert len(found.programs) == 2


def test_a_configuration_that_scales_its_demand_is_refused(tmp_path):
    assert find_files(configured(tmp_path, '<scale value="1"/>'))
    with pytest.raises(UserError, match="a scale of 3; only 1 is read") as caught:
        find_files(configured(tmp_path, '<scale value="3"/>'))
    assert caught.value.field == "sumo-net"


def test_a_signal_that_no_vehicle_passes_is_skipped(tmp_path):
    path = star(tmp_path, CROSS, 1)
    tree = ElementTree.parse(path)
    logic = tree.find("tlLogic")
    alone = ElementTree.Element("tlLogic", {**logic.attrib, "id": "alone"})
    alone.extend(logic)
    tree.getroot().insert(list(tree.getroot()).index(logic), alone)
    tree.write(path)
    _, network = read(path)
    assert network.ids == ("c",)
