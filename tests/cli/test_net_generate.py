"""``tsc-net generate`` and ``tsc-net check``, as a user does it."""

import json

import pytest

from tests.cli.test_bad_input import refused

SHAPE = ("--rows", 2, "--columns", 3, "--east-west", 250, "--north-south", 180)
GAPS = ("--remove", "2,2-2,3", "--remove", "1,1-2,1", "--remove", "1,1-1,0", "--remove", "0,1-1,1")
DEMAND = ("--vehicles-per-hour", 1200, "--horizon", 600, "--course", "gaussian", "--through", 0.3)


def generate(command, name, *options):
    done = command("net", "generate", *options, "--out", name)
    assert done.returncode == 0, done.stderr
    return command.cwd / name, done.stdout


def test_a_grid_with_gaps_runs_and_is_the_same_again(command):
    options = (*SHAPE, *GAPS, *DEMAND, "--seed", 4)
    net, printed = generate(command, "a", *options)
    assert "a: 5 intersections" in printed  # the sixth keeps one road: a dead end
    again, _ = generate(command, "b", *options)
    for name in ("net.net.xml", "network.json", "routes.rou.xml"):
        assert (net / name).read_bytes() == (again / name).read_bytes()
    manifest = json.loads((net / "manifest.json").read_text())
    assert manifest["kind"] == "generated"
    assert "--remove 2,2-2,3 --remove 1,1-2,1" in manifest["recipe"]
    assert "--out" not in manifest["recipe"]
    expected = 1200 * 600 / 3600
    assert manifest["vehicles"] == pytest.approx(expected, rel=0.15)
    words = manifest["recipe"].split()[2:]
    repeated, _ = generate(command, "c", *words)
    assert (repeated / "routes.rou.xml").read_bytes() == (net / "routes.rou.xml").read_bytes()
    words = ["--controller: as-built", "a (generated) came without signal programs"]
    refused(command, "run", "--net", net, "--controller", "as-built", words=words)
    for controller in ("max-queue", "fixed-time", "actuated"):
        arguments = ("--net", net, "--horizon", 600, "--controller", controller, "--json")
        done = command("run", *arguments, "--no-decisions")
        assert done.returncode == 0, done.stderr
        found = json.loads(done.stdout)
        assert found["demand"] == "generated"
        result = found["result"]
        assert result["never_inserted"] == result["teleports"] == result["collisions"] == 0
        assert result["fallbacks"] == 0
        assert result["finished"] > 0.5 * result["demand"]


def test_an_arterial_and_where_its_demand_cannot_enter(command):
    shape = ("--rows", 1, "--columns", 2, "--lanes", "l,s,sr", "--side-lanes", 1)
    net, printed = generate(command, "art", *shape, "--vehicles-per-hour", 20000, "--horizon", 600)
    assert "warning: road_1_0_1: up to " in printed
    record = json.loads((net / "network.json").read_text())
    lanes = {}
    for lane in record["lanes"].values():
        lanes[lane["road"]] = lanes.get(lane["road"], 0) + 1
    assert (lanes["road_0_1_0"], lanes["road_1_0_1"]) == (3, 1)
    done = command("net", "check", net, "--json", "--horizon", 600)
    assert done.returncode == 0, done.stderr
    findings = json.loads(done.stdout)["findings"]
    texts = [f"{finding['about']}: {finding['text']}" for finding in findings]
    assert any("more wants to enter than the lanes take" in text for text in texts)
    assert any("longer than an area detector" in text for text in texts)
    assert any("wait for gaps" in text for text in texts)
    assert not any("no phase serves" in text for text in texts)


def test_area_sensors_on_lanes_whose_length_has_millimetres(command):
    shape = ("--rows", 1, "--columns", 1, "--east-west", 310.117)
    net, _ = generate(command, "odd", *shape, "--vehicles-per-hour", 600, "--horizon", 60)
    record = json.loads((net / "network.json").read_text())
    lengths = [lane["length"] for lane in record["lanes"].values()]
    assert any(round(length, 2) > length for length in lengths)
    done = command("run", "--net", net, "--horizon", 60, "--sensor", "area", "--json")
    assert done.returncode == 0, done.stderr


def test_check_in_words(command, small_net):
    done = command("net", "check", small_net, "--detector-length", 500)
    assert done.returncode == 0, done.stderr
    assert "demand: no vehicle wants to use any movement of: " in done.stdout
    refused(command, "net", "check", "nowhere", words=["nowhere"])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--rows", "0"], ["rows", "0"]),
        (["--lanes", "x"], ["--lanes", "x", "l,s,sr"]),
        (["--turns", "a,b"], ["--turns", "a,b"]),
        (["--turns", "0,0,0"], ["--turns", "0"]),
        (["--course", "pek"], ["--course", "pek", "did you mean peak?"]),
        (["--vehicles-per-hour", "0"], ["--vehicles-per-hour", "0"]),
        (["--through", "1.5"], ["--through", "1.5"]),
        (["--remove", "1,1-3,1"], ["--remove: 1,1-3,1"]),
        (["--east-west", "20"], ["--east-west", "20", "30"]),
        (["--speed", "-1"], ["--speed", "-1"]),
        (["--speed", "500"], ["--speed: 500", "70"]),
        (["--north-south", "1e9"], ["--north-south", "20000"]),
        (["--lanes", "r,s,l"], ["--lanes: r,s,l", "left to right"]),
        (["--turns", "1,1"], ["--turns: 1,1", "left,straight,right"]),
        (["--vehicles-per-hour", "0.1"], ["--vehicles-per-hour: 0.1", "none enters"]),
        (
            ["--rows", "1", "--columns", "1", "--remove", "0,1-1,1", "--remove", "1,0-1,1"],
            ["--remove: 0,1-1,1 1,0-1,1", "three roads"],
        ),
        (
            ["--rows", "2", "--columns", "2", "--remove-share", "0.9"],
            ["--remove-share: 0.9", "three roads"],
        ),
        (["--lanes", "r"], ["--lanes: r", "right turns"]),
    ],
)
def test_bad_input(command, arguments, words):
    refused(command, "net", "generate", *arguments, "--out", "x", words=words)
