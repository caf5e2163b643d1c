"""CityFlow networks become SUMO nets whose slots, phases and neighbours are those of the net."""

import json
import shutil

import numpy as np
import pytest
import sumolib

from tests.cityflow_files import grid_flows, grid_roadnet, road, tee_roadnet, write
from tests.shared import CITYFLOW, needs_shared
from tsc_missing.errors import UserError
from tsc_missing.network.cityflow import read_roadnet
from tsc_missing.network.compile import compile_network, read_net
from tsc_missing.network.folder import NET, read_folder
from tsc_missing.network.grid import build_grid, read_grid
from tsc_missing.network.importing import import_cityflow
from tsc_missing.network.slots import APPROACHES, N_SLOTS, TURNS, assign_approaches, slot_index
from tsc_missing.paths import bundled
from tsc_missing.simulation.states import check_state, green_state

N, E, S, W = range(4)
LEFT, STRAIGHT, RIGHT = range(3)
COMPASS = {0: W, 1: S, 2: E, 3: N}  # CityFlow's direction of travel to where traffic comes from


@pytest.fixture(scope="module", params=[(2, 3), (3, 4), (1, 2)], ids=str)
def grid(request, tmp_path_factory):
    rows, columns = request.param
    folder = tmp_path_factory.mktemp("grid")
    roadnet, flow = write(folder, grid_roadnet(rows, columns), grid_flows(rows, columns))
    import_cityflow(roadnet, flow, folder / "net", "net", 600)
    return read_folder(folder / "net", "net")


@pytest.fixture(scope="module")
def tee(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tee")
    roadnet, _flow = write(folder, tee_roadnet(), grid_flows(0, 0)[:0])
    import_cityflow(roadnet, None, folder / "net", "net", 600)
    return read_folder(folder / "net", "net")


def upstream_by_net(folder, network):
    """The neighbour slots of each slot, read from the SUMO net and not from our tables."""
    net = sumolib.net.readNet(str(folder.net_file))
    index = {name: n for n, name in enumerate(network.ids)}
    slot_of_lane = {
        lane: (n, slot)
        for n, slots in enumerate(network.slot_lanes)
        for slot, lanes in enumerate(slots)
        for lane in lanes
    }
    table = {}
    for n, slots in enumerate(network.slot_lanes):
        for slot, lanes in enumerate(slots):
            feeders = set()
            for lane in lanes:
                edge = net.getLane(lane).getEdge()
                for source, connections in edge.getIncoming().items():
                    if source.getToNode().getID() in index:
                        feeders |= {
                            slot_of_lane[connection.getFromLane().getID()]
                            for connection in connections
                        }
            table[n, slot] = feeders
    return table


def test_neighbour_slots_are_those_of_the_net(grid):
    network = grid.network
    for (n, slot), feeders in upstream_by_net(grid, network).items():
        row = network.neighbours[n, slot]
        assert {(int(k) // N_SLOTS, int(k) % N_SLOTS) for k in row[row >= 0]} == feeders


@needs_shared
def test_neighbour_slots_of_new_york_are_those_of_the_net(tmp_path):
    import_cityflow(CITYFLOW / "roadnet_16_3.json", None, tmp_path / "net", "newyork", 3600)
    folder = read_folder(tmp_path / "net", "newyork")
    assert folder.network.n == 48
    for (n, slot), feeders in upstream_by_net(folder, folder.network).items():
        row = folder.network.neighbours[n, slot]
        assert {(int(k) // N_SLOTS, int(k) % N_SLOTS) for k in row[row >= 0]} == feeders
    assert (folder.network.neighbours >= 0).any(axis=2).sum() == 2 * (16 * 2 + 15 * 3) * 3


def test_lanes_are_in_the_slots_of_their_approach_and_turn(grid):
    network = grid.network
    for n, node in enumerate(network.intersections):
        assert network.slot_mask[n].all()
        for slot, lanes in enumerate(network.slot_lanes[n]):
            (lane,) = lanes
            name, number = lane.rsplit("_", 1)
            assert COMPASS[int(name[-1])] == slot // len(TURNS)
            # CityFlow lane 0 is the innermost (left), which is SUMO's lane 2.
            assert {"2": LEFT, "1": STRAIGHT, "0": RIGHT}[number] == slot % len(TURNS)
        assert {link.from_lane for link in node.links} == {
            lane for lanes in network.slot_lanes[n] for lane in lanes
        }


def test_lane_order_against_the_geometry_of_the_net(grid):
    net = sumolib.net.readNet(str(grid.net_file))
    for slots in grid.network.slot_lanes:
        for slot, (lane,) in enumerate(slots):
            directions = {c.getDirection() for c in net.getLane(lane).getOutgoing()}
            assert directions == {"lsr"[slot % len(TURNS)]}


def test_phases_are_the_papers_four(grid):
    expected = [
        {slot_index(W, STRAIGHT), slot_index(E, STRAIGHT)},
        {slot_index(N, STRAIGHT), slot_index(S, STRAIGHT)},
        {slot_index(W, LEFT), slot_index(E, LEFT)},
        {slot_index(N, LEFT), slot_index(S, LEFT)},
    ]
    for phases in grid.network.phases:
        assert [set(np.flatnonzero(phase)) for phase in phases] == expected
    assert {slot % 3 for slot in np.flatnonzero(grid.network.free_slots[0])} == {RIGHT}


def test_no_phase_has_a_conflict(grid):
    for node in grid.network.intersections:
        for phase in node.phases:
            assert not any(b in node.foes[a] for a in phase.links for b in phase.links)


def test_right_turns_give_way_and_straight_does_not(grid):
    for node in grid.network.intersections:
        for link, record in enumerate(node.links):
            if record.slot % 3 == RIGHT:
                assert node.yields[link] == node.foes[link]
            if record.slot % 3 == STRAIGHT:
                assert node.yields[link] == ()


def test_tee_with_a_shared_lane(tee):
    network = tee.network
    names = {f"{APPROACHES[s // 3]}-{TURNS[s % 3]}" for s in np.flatnonzero(network.slot_mask[0])}
    assert names == {"W-straight", "W-right", "E-straight", "E-left", "S-left", "S-right"}
    south = network.slot_lanes[0][slot_index(S, LEFT)]
    assert south == network.slot_lanes[0][slot_index(S, RIGHT)] == (f"{road(1, 0, 1)}_0",)
    lane, _flat, weight = network.lane_slots
    shared = [weight[k] for k, lane_ in enumerate(lane) if network.entrance_lanes[lane_] in south]
    assert shared == [0.5, 0.5]
    assert np.bincount(lane, weight).tolist() == [1.0] * len(network.entrance_lanes)
    assert network.phase_mask.sum() == 3
    assert not network.phases[0][:, ~network.slot_mask[0]].any()


def test_first_phases_that_serve_everything_or_all(tmp_path):
    content = grid_roadnet(1, 1)
    node = next(i for i in content["intersections"] if not i["virtual"])
    lights = node["trafficLight"]["lightphases"]
    one_approach = [
        k for k, link in enumerate(node["roadLinks"]) if link["startRoad"] == road(0, 1, 0)
    ]
    free = lights[0]["availableRoadLinks"]
    lights.append({"time": 30, "availableRoadLinks": sorted({*free, *one_approach})})
    path, _ = write(tmp_path, content, [])
    assert len(read_roadnet(path).nodes["intersection_1_1"].phases) == 4
    assert len(read_roadnet(path, all_phases=True).nodes["intersection_1_1"].phases) == 5


def test_import_twice_gives_the_same_bytes(tmp_path):
    roadnet, flow = write(tmp_path, grid_roadnet(1, 2), grid_flows(1, 2))
    for name in ("one", "two"):
        import_cityflow(roadnet, flow, tmp_path / name, "net", 600)
    for file in (tmp_path / "one").iterdir():
        assert file.read_bytes() == (tmp_path / "two" / file.name).read_bytes()


def test_a_changed_net_is_noticed(grid, tmp_path):
    copy = shutil.copytree(grid.path, tmp_path / "copy")
    (copy / NET).write_text((copy / NET).read_text() + "\n")
    with pytest.raises(UserError, match="checksum"):
        read_folder(copy, "copy")


@pytest.mark.parametrize(
    ("bearings", "approaches"),
    [
        ([0, 90, 180, 270], [N, E, S, W]),
        ([270, 0], [W, N]),
        ([44, 46], [N, E]),
        ([80, 100, 270], [N, E, W]),
        ([350, 10, 90, 180], [W, N, E, S]),
        ([0, 72, 144, 216, 288], [N, E, S, S, W]),
    ],
)
def test_approaches_follow_the_compass(bearings, approaches):
    assert assign_approaches(bearings) == approaches


def spoil(path, change):
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    return path


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda net: net["roads"][0].update(endIntersection="nowhere"), "unknown intersection"),
        (lambda net: net["roads"][0].pop("lanes"), "roads.0.lanes"),
        (lambda net: net["roads"][0]["lanes"][0].update(width=-1), "roads.0.lanes.0.width"),
        (lambda net: net.update(intersections=[]), "unknown intersection"),
        (lambda net: [i.pop("trafficLight") for i in net["intersections"]], "has signals"),
        (lambda net: net["roads"].append(net["roads"][0]), "road road_.* is there twice"),
        (lambda net: net["intersections"].append(net["intersections"][0]), "there twice"),
        (lambda net: net["roads"][0].update(id="in 0"), "roads.0.id: SUMO takes no ' '"),
        (lambda net: net["intersections"][0].update(id="a&b"), "SUMO takes no '&'"),
        (lambda net: net["roads"][0].update(id="a,b"), "SUMO takes no ','"),
        (lambda net: net["roads"][0]["points"][0].update(x=float("nan")), "points.0.x"),
        (lambda net: net["roads"][0].update(points=[{"x": 1, "y": 2}] * 2), "has no length"),
    ],
)
def test_bad_roadnets_name_the_place(tmp_path, change, words):
    roadnet, _ = write(tmp_path, grid_roadnet(1, 1), [])
    with pytest.raises(UserError, match=words):
        read_roadnet(spoil(roadnet, change))


def with_phases(*phases):
    """A crossing whose light phases are of (type, direction of travel) each."""
    content = grid_roadnet(1, 1)
    node = next(i for i in content["intersections"] if not i["virtual"])
    links = [(link["type"], link["startRoad"][-1]) for link in node["roadLinks"]]
    node["trafficLight"]["lightphases"] = [
        {"time": 30, "availableRoadLinks": [k for k, link in enumerate(links) if link in phase]}
        for phase in phases
    ]
    return content


EAST, NORTH, WEST, SOUTH = (("go_straight", d) for d in "0123")
EAST_LEFT, NORTH_LEFT, WEST_LEFT, SOUTH_LEFT = (("turn_left", d) for d in "0123")


@pytest.mark.parametrize(
    ("phase", "words"),
    [
        ({EAST, WEST, NORTH, SOUTH}, "straight from road_.* and straight from road_.* cross"),
        ({EAST, NORTH_LEFT}, "left from road_.* and straight from road_|straight .* left"),
        ({EAST_LEFT, NORTH_LEFT}, "left from .* left from"),
    ],
)
def test_phases_whose_greens_conflict_are_refused(tmp_path, phase, words):
    content = with_phases(phase, {EAST, WEST}, {NORTH, SOUTH})
    roadnet, _ = write(tmp_path, content, [])
    with pytest.raises(UserError, match=rf"roadnet.json .* light phase 0: .*({words})"):
        import_cityflow(roadnet, None, tmp_path / "net", "net", 600)
    assert not (tmp_path / "net").exists()


def test_a_road_that_leads_nowhere_at_a_signal(tmp_path):
    """No connection is made up for it."""
    content = grid_roadnet(1, 1)
    node = next(i for i in content["intersections"] if not i["virtual"])
    kept = [k for k, link in enumerate(node["roadLinks"]) if link["startRoad"] != road(0, 1, 0)]
    node["roadLinks"] = [node["roadLinks"][k] for k in kept]
    for phase in node["trafficLight"]["lightphases"]:
        links = phase["availableRoadLinks"]
        phase["availableRoadLinks"] = [kept.index(k) for k in links if k in kept]
    roadnet, _ = write(tmp_path, content, [])
    import_cityflow(roadnet, None, tmp_path / "net", "net", 600)
    folder = read_folder(tmp_path / "net", "net")
    (found,) = folder.network.intersections
    assert road(0, 1, 0) not in found.roads
    assert len(found.links) == 27
    assert not sumolib.net.readNet(str(folder.net_file)).getEdge(road(0, 1, 0)).getOutgoing()


def test_an_all_red_phase_changes_nothing(tmp_path):
    roadnet, _ = write(tmp_path, grid_roadnet(1, 1), [])
    plain = read_roadnet(roadnet)

    def stop_all(content):
        for node in content["intersections"]:
            phases = node["trafficLight"]["lightphases"]
            phases.append({"time": 2, "availableRoadLinks": []})

    assert read_roadnet(spoil(roadnet, stop_all)) == plain


def test_projected_coordinates_keep_their_metres(tmp_path):
    near, _ = write(tmp_path, grid_roadnet(1, 1), [])
    content = grid_roadnet(1, 1)
    points = [p for r in content["roads"] for p in r["points"]]
    points += [node["point"] for node in content["intersections"]]
    for point in {id(point): point for point in points}.values():
        point["x"], point["y"] = point["x"] + 13377046.25, point["y"] + 3535049.5
    (tmp_path / "far").mkdir()
    far, _ = write(tmp_path / "far", content, [])
    lengths = []
    for name, roadnet in (("a", near), ("b", far)):
        import_cityflow(roadnet, None, tmp_path / name, "net", 600)
        network = read_folder(tmp_path / name, "net").network
        lengths.append([lane.length for lane in network.record.lanes.values()])
    np.testing.assert_allclose(*lengths, atol=0.05)


def star_roadnet(arms):
    """Roads from all around, one phase each, one lane for all movements."""
    centre = {"id": "c", "point": {"x": 0, "y": 0}, "width": 20, "virtual": False}
    nodes, roads = [centre], []
    for k in range(arms):
        angle = 2 * np.pi * k / arms
        place = {"x": 200 * float(np.sin(angle)), "y": 200 * float(np.cos(angle))}
        nodes.append({"id": f"n{k}", "point": place, "virtual": True})
        for name, start, end in (("in", f"n{k}", "c"), ("out", "c", f"n{k}")):
            points = [place, centre["point"]][:: 1 if name == "in" else -1]
            ends = {"startIntersection": start, "endIntersection": end}
            lanes = [{"width": 3.5, "maxSpeed": 11.111}]
            roads.append({"id": f"{name}{k}", "points": points, "lanes": lanes, **ends})
    pairs = [(k, (k + turn) % arms) for k in range(arms) for turn in range(1, arms)]
    centre["roadLinks"] = [
        {
            "type": "turn_left" if (b - a) % arms == 1 else "go_straight",
            "startRoad": f"in{a}",
            "endRoad": f"out{b}",
            "laneLinks": [{"startLaneIndex": 0, "endLaneIndex": 0}],
        }
        for a, b in pairs
    ]
    centre["trafficLight"] = {
        "lightphases": [
            {"time": 30, "availableRoadLinks": [i for i, (a, _) in enumerate(pairs) if a == k]}
            for k in range(arms)
        ]
    }
    return {"intersections": nodes, "roads": roads}


@pytest.mark.parametrize("arms", [5, 6, 7])
def test_more_than_four_roads_have_slots_of_their_own(tmp_path, arms):
    roadnet, _ = write(tmp_path, star_roadnet(arms), [])
    manifest = import_cityflow(roadnet, None, tmp_path / "net", "net", 600)
    assert any("more than four roads" in note for note in manifest.notes)
    network = read_folder(tmp_path / "net", "net").network
    assert network.phase_mask.sum() == arms
    assert len({tuple(phase) for phase in network.phases[0].tolist()}) == arms
    slots = [
        {link.slot for link in network.intersections[0].links if link.from_lane == f"in{k}_0"}
        for k in range(arms)
    ]
    assert all(not one & other for k, one in enumerate(slots) for other in slots[:k])


def test_what_is_odd_is_noted(tmp_path):
    content = with_phases({EAST, WEST, EAST_LEFT, WEST_LEFT}, {NORTH, SOUTH})
    for link in (k for node in content["intersections"] for k in node["roadLinks"]):
        link["laneLinks"] = [{"startLaneIndex": 0, "endLaneIndex": 0}]
    flows = grid_flows(1, 1)
    flows[0]["vehicle"] = {**flows[0]["vehicle"], "length": 12.0}
    roadnet, flow = write(tmp_path, content, flows)
    notes = import_cityflow(roadnet, flow, tmp_path / "net", "net", 600).notes
    assert len(notes) == 2
    assert "no phase serves, so nobody gets through: intersection_1_1 N-left" in notes[0]
    assert f"the flow has length 12.0 in 1 of {len(flows)} entries, not 5" in notes[1]
    content = with_phases({EAST, WEST}, {EAST_LEFT, WEST_LEFT}, {NORTH, SOUTH})
    for link in (k for node in content["intersections"] for k in node["roadLinks"]):
        link["laneLinks"] = [{"startLaneIndex": 0, "endLaneIndex": 0}]
    roadnet, _ = write(tmp_path, content, [])
    notes = import_cityflow(roadnet, None, tmp_path / "apart", "net", 600).notes
    assert any("one blocks the other: road_" in note for note in notes)


def test_lanes_of_one_road_that_cross_give_way(tmp_path):
    """Right turns that leave a lane inside the straight lane: they do not drive through it."""
    content = grid_roadnet(1, 1)
    lanes = {"turn_left": 0, "turn_right": 1, "go_straight": 2}
    for link in (k for node in content["intersections"] for k in node["roadLinks"]):
        start = lanes[link["type"]]
        link["laneLinks"] = [{"startLaneIndex": start, "endLaneIndex": k} for k in range(3)]
    roadnet, _ = write(tmp_path, content, [])
    import_cityflow(roadnet, None, tmp_path / "net", "net", 600)
    (node,) = read_folder(tmp_path / "net", "net").network.intersections
    for phase in range(2):
        state = green_state(node, phase)
        check_state(node, state)
        for link in node.phases[phase].links:
            turns = [k for k in node.free if node.links[k].slot // 3 == node.links[link].slot // 3]
            assert node.links[link].slot % 3 == STRAIGHT
            assert len(turns) == 3
            assert set(turns) <= set(node.foes[link])
            assert {state[k] for k in turns} == {"g"}
            assert all(link in node.yields[k] for k in turns)


def test_lanes_of_one_movement_that_lead_to_all_exit_lanes(tmp_path):
    content = grid_roadnet(1, 1)
    for item in content["roads"]:
        item["lanes"] = item["lanes"][:1] * 4
    lanes = {"turn_left": [0], "go_straight": [1, 2], "turn_right": [3]}
    for link in (k for node in content["intersections"] for k in node["roadLinks"]):
        link["laneLinks"] = [
            {"startLaneIndex": start, "endLaneIndex": end}
            for start in lanes[link["type"]]
            for end in range(4)
        ]
    roadnet, _ = write(tmp_path, content, [])
    import_cityflow(roadnet, None, tmp_path / "net", "net", 600)
    (node,) = read_folder(tmp_path / "net", "net").network.intersections
    for phase in range(len(node.phases)):
        check_state(node, green_state(node, phase))


@pytest.mark.parametrize("city", ["jinan", "hangzhou", "newyork"])
def test_the_bundled_records_are_what_their_nets_compile_to(city):
    folder = read_folder(bundled("networks") / city, city)
    plain = build_grid(read_grid(folder.path / "grid.toml"))
    assert compile_network(read_net(folder.net_file), plain) == folder.network.record


def test_left_turns_across_oncoming_traffic_may_share_its_phase(tmp_path):
    content = with_phases({EAST, WEST, EAST_LEFT, WEST_LEFT}, {NORTH, SOUTH, NORTH_LEFT})
    roadnet, _ = write(tmp_path, content, [])
    import_cityflow(roadnet, None, tmp_path / "net", "net", 600)
    assert read_folder(tmp_path / "net", "net").network.phase_mask.sum() == 2
