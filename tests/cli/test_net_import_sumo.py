"""``tsc-net import`` of SUMO nets and OSM extracts, and runs on them, as a user does it."""

import gzip
import importlib.util
import json
import re
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pyarrow.parquet as pq
import pytest

from tests.cli.test_bad_input import refused
from tests.sumo_files import star, town, write_routes
from tsc_missing.network.folder import read_folder
from tsc_missing.network.netconvert import sumo_tool

BEGIN = 25200
SHORT = ("--horizon", 150, "--json", "--no-decisions")
TRUCK = '<vType id="truck" vClass="truck" length="12" speedDev="0"/>'
CAR = '<vType id="car" length="4" speedDev="0" sigma="0"/>'
VEHICLES = (
    TRUCK,
    CAR,
    f'<vehicle id="v" type="truck" depart="{BEGIN + 1}"><route edges="in_0 out_2"/></vehicle>',
    f'<vehicle id="early" type="car" depart="{BEGIN - 60}"><route edges="in_0 out_2"/></vehicle>',
    *(
        f'<trip id="t{k}" type="car" depart="{BEGIN + 2 * k}" from="in_{k % 4}" '
        f'to="out_{(k + 2) % 4}"/>'
        for k in range(20)
    ),
    f'<flow id="f" type="car" begin="{BEGIN}" end="{BEGIN + 100}" period="10" from="in_1" '
    'to="out_2"/>',
)


@pytest.fixture(scope="module")
def crossing(tmp_path_factory) -> Path:
    """A folder with a net, routes and a configuration that begins at seven in the morning."""
    folder = tmp_path_factory.mktemp("crossing")
    star(folder, (0, 90, 180, 270), 2)
    write_routes(folder / "cars.rou.xml", *VEHICLES)
    write_routes(
        folder / "people.rou.xml",
        f'<person id="p" depart="{BEGIN}"><walk edges="in_0 out_1"/></person>',
        f'<trip id="bus" depart="{BEGIN}" from="in_3" to="out_0"><stop lane="in_3_0" endPos="50" '
        'duration="9"/></trip>',
    )
    (folder / "all.sumocfg").write_text(
        '<configuration><input><net-file value="star.net.xml"/>'
        '<route-files value="cars.rou.xml, people.rou.xml"/></input>'
        f'<time><begin value="{BEGIN}"/><end value="7:05:00"/></time></configuration>'
    )
    return folder


@pytest.fixture
def imported(crossing, command):
    done = command("net", "import", "--sumo-net", crossing / "all.sumocfg", "--out", "net")
    assert done.returncode == 0, done.stderr
    assert "net: 1 intersection, 32 vehicles" in done.stdout
    assert "note: left out: 1 person element\n" in done.stdout
    assert "note: left out: 1 stop" in done.stdout
    return command.cwd / "net"


def run(command, net, *options):
    done = command("run", "--net", net, *SHORT, *options)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_times_types_and_routes_are_kept(imported):
    manifest = json.loads((imported / "manifest.json").read_text())
    assert (manifest["kind"], manifest["begin"], manifest["horizon"]) == ("sumo", BEGIN, 300)
    assert set(manifest["sources"]) == {
        "all.sumocfg",
        "star.net.xml",
        "cars.rou.xml",
        "people.rou.xml",
    }
    root = ElementTree.parse(imported / "routes.rou.xml").getroot()
    types = {kind.get("id"): kind.get("length") for kind in root.iter("vType")}
    assert {float(types["truck"]), float(types["car.recorded"])} == {12.0, 4.0}
    departs = [float(vehicle.get("depart")) for vehicle in root.iter("vehicle")]
    assert departs == sorted(departs)
    assert departs[0] == BEGIN
    assert sum(vehicle.get("type") == "truck" for vehicle in root.iter("vehicle")) == 1


def test_conventional_controllers_and_the_program_as_built(imported, command):
    results = {
        name: run(command, imported, "--controller", name)["result"]
        for name in ("max-queue", "fixed-time", "actuated", "as-built")
    }
    for result in results.values():
        assert result["inserted"] == result["demand"] == 32
        assert result["finished"] >= 25
        assert result["teleports"] == result["collisions"] == result["fallbacks"] == 0
        assert result["never_inserted"] == 0


def test_vehicles_keep_their_ids_and_types(imported, command):
    found = run(command, imported, "--controller", "fixed-time")
    table = pq.read_table(command.cwd / found["out"] / "trips.parquet").to_pydict()
    own = {f"t{k}" for k in range(20)} | {f"f.{k}" for k in range(10)} | {"v", "bus"}
    assert set(table["id"]) == own
    assert table["vehicle"] == list(range(32))
    of = {name: row for row, name in enumerate(table["id"])}
    assert table["type"][of["v"]] == "truck"
    assert table["type"][of["t3"]] == table["type"][of["f.1"]] == "car"
    assert (table["origin"][of["t3"]], table["scheduled"][of["t3"]]) == ("in_3", 6)


def test_as_built_is_what_sumo_itself_does(imported, command, crossing):
    ours = run(command, imported, "--controller", "as-built")
    assert ours["begin"] == BEGIN
    trips = command.cwd / "tripinfo.xml"
    options = ["-n", crossing / "star.net.xml", "-r", imported / "routes.rou.xml"]
    more = ["--begin", BEGIN, "--end", BEGIN + 150, "--time-to-teleport", -1, "--seed", 0]
    outputs = ["--tripinfo-output", trips, "--tripinfo-output.write-unfinished", "--no-step-log"]
    command_line = [sumo_tool("sumo"), *map(str, [*options, *more, *outputs])]
    subprocess.run(command_line, check=True, capture_output=True)
    rows = list(ElementTree.parse(trips).getroot())
    finished = [float(row.get("duration")) for row in rows if float(row.get("arrival")) >= 0]
    assert ours["result"]["finished"] == len(finished)
    mean = sum(finished) / len(finished)
    assert ours["result"]["att_finished"] == pytest.approx(mean, abs=1e-6)


def test_missing_data_and_area_sensors(imported, command):
    found = run(command, imported, "--missing", "random", "--rate", 0.5, "--sensor", "area")
    assert 0 < found["result"]["missing_share"] < 1


def test_signal_programs_of_additional_files(crossing, command):
    tree = ElementTree.parse(crossing / "star.net.xml")
    logic = tree.find("tlLogic")
    logic.set("programID", "other")
    for phase in logic:
        phase.set("duration", "7")
    text = ElementTree.tostring(logic, encoding="unicode")
    (crossing / "lights.add.xml").write_text(f"<additional>{text}<poi id='x'/></additional>")
    config = (crossing / "all.sumocfg").read_text()
    config = config.replace(
        "<route-files", '<additional-files value="lights.add.xml"/><route-files'
    )
    (crossing / "more.sumocfg").write_text(config)
    done = command("net", "import", "--sumo-net", crossing / "more.sumocfg", "--out", "more")
    assert done.returncode == 0, done.stderr
    assert "left out: 1 poi" in done.stdout
    assert 'programID="other"' in (command.cwd / "more" / "signals.add.xml").read_text()
    assert run(command, "more", "--controller", "as-built")["result"]["inserted"] == 32


def test_a_town_of_openstreetmap_with_generated_demand(command, tmp_path):
    extract = town(tmp_path / "town.osm")
    options = ("--osm", extract, "--vehicles-per-hour", 900, "--course", "peak", "--horizon", 600)
    done = command("net", "import", *options, "--out", "town")
    assert done.returncode == 0, done.stderr
    assert "town: 2 intersections, " in done.stdout
    again = command("net", "import", *options, "--out", "again")
    assert again.returncode == 0, again.stderr
    for name in ("net.net.xml", "network.json", "routes.rou.xml"):
        files = (command.cwd / "town" / name, command.cwd / "again" / name)
        assert files[0].read_bytes() == files[1].read_bytes()
    found = run(command, "town", "--controller", "max-pressure")
    assert found["demand"] == "generated"
    assert found["result"]["inserted"] > 0
    assert found["result"]["collisions"] == 0


def test_a_town_where_traffic_drives_on_the_left(command, tmp_path):
    extract = town(tmp_path / "town.osm")
    options = ("--osm", extract, "--left-hand", "--vehicles-per-hour", 900, "--horizon", 150)
    done = command("net", "import", *options, "--out", "town")
    assert done.returncode == 0, done.stderr
    assert "traffic drives on the left" in done.stdout
    assert json.loads((command.cwd / "town" / "network.json").read_text())["left_hand"]
    assert run(command, "town", "--controller", "max-queue")["result"]["inserted"] > 0


def test_the_begin_is_a_time(crossing, command):
    arguments = ("net", "import", "--sumo-net", crossing / "star.net.xml", "--out", "x", "--begin")
    for begin in ("-1", "nan", "inf"):
        refused(command, *arguments, begin, words=[f"--begin: {begin}", "0 or more"])


def test_bad_nets(crossing, command, tmp_path):
    plain = star(tmp_path, (0, 90, 180, 270), 1, kind="priority")
    arguments = ("net", "import", "--out", "x", "--sumo-net")
    refused(command, *arguments, plain, words=["sumo-net", "no junction in it has traffic signals"])
    refused(command, *arguments, "none.net.xml", words=["none.net.xml", "no such file"])
    refused(command, *arguments, crossing / "cars.rou.xml", words=["cars.rou.xml", "SUMO net"])
    net = crossing / "star.net.xml"
    refused(command, *arguments, net, "--signals", "b", words=["signals", "b", "allowed: c"])
    refused(command, *arguments, net, "--osm", net, words=["--osm", "give one of"])
    refused(command, *arguments, net, "--flow", net, words=["--flow", "--sumo-net"])
    refused(command, *arguments, net, "--left-hand", words=["--left-hand", "--sumo-net"])
    refused(command, "net", "import", "--out", "x", words=["give one of", "--osm"])
    (tmp_path / "one").mkdir()
    single = star(tmp_path / "one", (0, 180), 1)
    tree = ElementTree.parse(single)
    for connection in tree.iter("connection"):
        if connection.get("from") == "in_1":
            connection.attrib.pop("tl", None)
            connection.attrib.pop("linkIndex", None)
    tree.write(single)
    refused(command, *arguments, single, words=["c (one approach)"])
    refused(command, *arguments, single, "--signals", "c", words=["signals", "c", "one approach"])


def test_bad_routes(crossing, command, tmp_path):
    arguments = ("net", "import", "--out", "x", "--sumo-net", crossing / "star.net.xml", "--routes")
    foreign = write_routes(
        tmp_path / "foreign.rou.xml", '<trip id="t" depart="0" from="here" to="there"/>'
    )
    refused(command, *arguments, foreign, words=["routes", "for this net", "here"])
    empty = write_routes(tmp_path / "empty.rou.xml")
    refused(command, *arguments, empty, words=["routes", "no vehicle, trip or flow"])
    cars = crossing / "cars.rou.xml"
    words = ["routes", "departs from 0 s", f"runs from {BEGIN - 60} s to 25300 s", "--begin"]
    refused(command, *arguments, cars, words=words)
    refused(command, *arguments, crossing / "star.net.xml", words=["routes", "<net>"])
    refused(command, *arguments, "none.rou.xml", words=["routes", "none.rou.xml"])
    both = (cars, "--vehicles-per-hour", 100)
    refused(command, *arguments, *both, words=["vehicles-per-hour", "routes"])
    arguments = arguments[:-1]
    refused(command, *arguments, "--vehicles-per-hour", -5, words=["--vehicles-per-hour", "-5"])
    words = ["--vehicles-per-hour: 0.001", "none enters in 3600 s"]
    refused(command, *arguments, "--vehicles-per-hour", 0.001, words=words)


def test_what_shapes_generated_demand_alone_is_refused(crossing, command):
    arguments = ("net", "import", "--out", "x", "--sumo-net")
    for given in ("star.net.xml", "all.sumocfg"):
        for option, value in (("--through", "0.2"), ("--course", "peak")):
            words = [f"{option}: {value}", "--vehicles-per-hour"]
            refused(command, *arguments, crossing / given, option, value, words=words)


def test_traffic_on_roads_that_are_not_there_is_left_out_and_counted(crossing, command):
    routes = write_routes(
        crossing / "mixed.rou.xml",
        '<route id="r" edges="in_0 nowhere"/>',
        '<route edges="nowhere"/>',
        '<trip id="good" depart="0" from="in_0" to="out_2"/>',
        '<trip id="a" depart="1" from="in_0" to="nowhere"/>',
        '<flow id="b" begin="1" end="90" number="9" from="where" to="out_2"/>',
        '<trip id="c" depart="2" from="in_0" to="out_2" via="elsewhere"/>',
        '<vehicle id="d" depart="3" route="r"/>',
        '<vehicle id="e" depart="4"><route edges="in_1 nowhere"/></vehicle>',
    )
    arguments = ("--sumo-net", crossing / "star.net.xml", "--routes", routes, "--out", "x")
    done = command("net", "import", *arguments)
    assert done.returncode == 0, done.stderr
    assert ", 1 vehicle\n" in done.stdout
    assert "left out: 5 vehicles, trips and flows on roads that the net lacks" in done.stdout


def test_flows_that_began_before(crossing, command):
    """Those of a probability too, with which duarouter would never come to an end."""
    routes = write_routes(
        crossing / "flows.rou.xml",
        '<flow id="p" begin="6:30:00" end="7:30:00" probability="0.2" from="in_0" to="out_2"/>',
        '<flow id="over" begin="0" end="7:00:00" probability="0.2" from="in_1" to="out_2"/>',
        '<flow id="q" begin="60" period="6" number="10" from="in_1" to="out_3"/>',
        '<flow id="r" end="7:01:00" period="6" from="in_1" to="out_3"/>',
        '<trip id="t" depart="7:00:10" from="in_0" to="out_2"/>',
    )
    arguments = ("net", "import", "--sumo-net", crossing / "star.net.xml", "--routes", routes)
    done = command(*arguments, "--begin", BEGIN, "--horizon", 1000, "--out", "cut")
    assert done.returncode == 0, done.stderr
    assert (
        "note: flows: 4 in all, 2 left out, 1 cut; the demand given runs from 0 s to 27000 s, "
        f"imported is what departs from {BEGIN} s to {BEGIN + 1000} s (--begin, --horizon)\n"
    ) in done.stdout
    root = ElementTree.parse(command.cwd / "cut" / "routes.rou.xml").getroot()
    vehicles = [(v.get("id").split(".")[0], float(v.get("depart"))) for v in root.iter("vehicle")]
    drawn = [depart for name, depart in vehicles if name == "p"]
    assert len(drawn) == pytest.approx(200, abs=40)
    assert BEGIN <= drawn[0] < drawn[-1] < BEGIN + 1000
    assert [depart - BEGIN for name, depart in vehicles if name == "r"] == list(range(0, 60, 6))
    assert len(vehicles) == len(drawn) + 10 + 1


def test_a_begin_that_was_forgotten(crossing, command):
    routes = write_routes(
        crossing / "late.rou.xml",
        '<trip id="a" depart="5" from="in_0" to="out_2"/>',
        f'<flow id="f" begin="{BEGIN}" period="9" from="in_1" to="out_2"/>',
    )
    arguments = ("--sumo-net", crossing / "star.net.xml", "--routes", routes, "--out", "x")
    done = command("net", "import", *arguments)
    assert done.returncode == 0, done.stderr
    words = "flows: 1 in all, 1 left out, 0 cut; the demand given runs from 5 s on"
    assert words in done.stdout
    assert "--begin" in done.stdout
    write_routes(routes, f'<flow id="f" begin="{BEGIN}" period="9" from="in_1" to="out_2"/>')
    words = ["no vehicle in it departs from 0 s on", f"runs from {BEGIN} s on", "--begin"]
    refused(command, "net", "import", *arguments[:-1], "y", words=words)


def test_packed_files_and_times_of_day(crossing, command, tmp_path):
    names = ("star.net.xml", "cars.rou.xml")
    for name in names:
        with gzip.open(tmp_path / f"{name}.gz", "wb") as packed:
            packed.write((crossing / name).read_bytes())
    net, cars = (tmp_path / f"{name}.gz" for name in names)
    arguments = ("net", "import", "--sumo-net", net, "--horizon", 300, "--begin", BEGIN)
    done = command(*arguments, "--routes", cars, "--out", "packed")
    assert done.returncode == 0, done.stderr
    assert "packed: 1 intersection, 31 vehicles" in done.stdout
    clock = write_routes(
        tmp_path / "clock.rou.xml",
        '<trip id="a" depart="7:04:10" from="in_0" to="out_2"/>',
        f'<trip id="b" depart="{BEGIN + 20}" from="in_0" to="out_2"/>',
        '<flow id="f" begin="6:59:00" end="0:7:02:00" number="3" from="in_1" to="out_2"/>',
        '<trip id="late" depart="0:07:05:00" from="in_0" to="out_2"/>',
    )
    done = command(*arguments, "--routes", clock, "--out", "clock")
    assert done.returncode == 0, done.stderr
    assert "clock: 1 intersection, 4 vehicles" in done.stdout
    assert "note: left out: 1 vehicle departing before" in done.stdout
    assert "sorted" not in done.stdout
    whole = (crossing / "cars.rou.xml").read_bytes()
    cars.write_bytes(gzip.compress(whole)[:-20])
    refused(command, *arguments, "--routes", cars, "--out", "x", words=["routes", "damaged"])


def test_lanes_for_bicycles_and_trams_have_links_and_no_cars(command, tmp_path):
    """Their links are the signal's, but cars neither enter nor leave by them."""
    grid = ("--grid", "--grid.number=2", "--grid.attach-length=200", "--grid.length=300", "-L", "2")
    signals = ("--default-junction-type=traffic_light", "--no-turnarounds")
    sizes = {}
    for name, more in (("plain", ()), ("more", ("--sidewalks.guess", "--bikelanes.guess"))):
        net = tmp_path / f"{name}.net.xml"
        words = [sumo_tool("netgenerate"), *grid, *signals, *more, "-o", str(net)]
        subprocess.run(words, check=True, capture_output=True)
        demand = ("--vehicles-per-hour", 35_000, "--horizon", 150)
        done = command("net", "import", "--sumo-net", net, *demand, "--out", name)
        assert done.returncode == 0, done.stderr
        assert "its 2 lanes take" in done.stdout
        assert run(command, command.cwd / name, "--controller", "fixed-time")["result"]["inserted"]
        assert command("net", "check", name).returncode == 0
        network = read_folder(command.cwd / name, name).network
        lanes = network.record.lanes
        assert {link.to_lane for node in network.intersections for link in node.links} <= set(lanes)
        sizes[name] = network.exit_lane_count.max()
    assert any(lane.aside for lane in lanes.values())
    assert sizes["plain"] == sizes["more"] == 2


def test_bad_extracts(command, tmp_path):
    arguments = ("net", "import", "--out", "x", "--osm")
    words = ["osm", "no road"]
    refused(command, *arguments, town(tmp_path / "a.osm", highway=False), words=words)
    words = ["no junction in it has traffic signals"]
    refused(command, *arguments, town(tmp_path / "b.osm", signals=False), words=words)
    (tmp_path / "c.osm").write_text("<osm")
    refused(command, *arguments, tmp_path / "c.osm", words=["osm", "OSM's XML"])
    alone = town(tmp_path / "d.osm")
    alone.write_text(re.sub(r'<way id="1[12]".*?</way>', "", alone.read_text(), flags=re.S))
    refused(command, *arguments, alone, words=[f"--osm: {alone}", "roads that cars may use"])


RESCO = importlib.util.find_spec("sumo_rl")


@pytest.mark.skipif(RESCO is None, reason="sumo-rl, which ships the RESCO networks, is not there")
@pytest.mark.parametrize(
    ("name", "intersections", "vehicles"), [("cologne3", 3, 2856), ("ingolstadt7", 7, 3031)]
)
def test_resco_networks_import_as_they_are(command, name, intersections, vehicles):
    folder = Path(RESCO.origin).parent / "nets" / "RESCO" / name
    done = command("net", "import", "--sumo-net", folder / f"{name}.sumocfg", "--out", name)
    assert done.returncode == 0, done.stderr
    assert f"{name}: {intersections} intersections, {vehicles} vehicles" in done.stdout
    blind = ["max-queue", "--missing", "kriging", "--rate", 0.25, "--sensor", "area"]
    for options in (blind, ["as-built"]):
        result = run(command, name, "--controller", *options)["result"]
        assert result["inserted"] > 0
        assert result["collisions"] == result["teleports"] == result["fallbacks"] == 0
