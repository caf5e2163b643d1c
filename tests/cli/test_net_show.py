"""``tsc-net show`` as it is used: the real command line."""

import json
from xml.etree import ElementTree

import pytest
import sumolib

from tests.cityflow_files import grid_roadnet, write
from tests.cli.test_bad_input import refused
from tsc_missing.network.importing import import_cityflow
from tsc_missing.words import counted

SVG = "{http://www.w3.org/2000/svg}"
KINDS = ("intersections", "always-observed", "partly-observed", "never-observed")


def show_json(command, *arguments):
    done = command("net", "show", "--json", *arguments)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return json.loads(done.stdout)


def marks(path):
    """The number of marks of each kind in an SVG picture."""
    groups = {group.get("id"): group for group in ElementTree.parse(path).iter(f"{SVG}g")}
    found = {
        name: len(list(group.iter(f"{SVG}use"))) or len(group.findall(f"{SVG}path"))
        for name, group in groups.items()
    }
    return {name: found[name] for name in KINDS if name in found}


def test_a_network_in_numbers_and_its_picture_by_default(command, small_net):
    done = command("net", "show", small_net)
    assert done.returncode == 0, done.stderr
    for words in ("small", "intersections", "movement slots", "E-straight, W-straight", "recorded"):
        assert words in done.stdout
    assert "written to small.png" in done.stdout
    assert [path.name for path in command.cwd.iterdir()] == ["small.png"]
    assert (command.cwd / "small.png").read_bytes().startswith(b"\x89PNG")


def test_json_is_the_only_output(command, small_net):
    out = show_json(command, small_net, "--out", "x.svg")
    assert out["out"] == "x.svg"
    assert (out["name"], out["kind"], out["sensors"]) == ("small", "cityflow", None)
    assert out["network"]["intersections"] == 6
    assert out["network"]["entrance_lanes"] == out["network"]["slots_present"] == 72
    assert out["network"]["boundary_entries"] == 10
    assert out["demand"]["kind"] == "recorded"
    assert out["demand"]["vehicles"] > 0
    assert marks(command.cwd / "x.svg") == {"intersections": 6}


def test_the_picture_shows_what_is_missing(command, small_net):
    options = ("--missing", "kriging", "--rate", 0.3, "--seed", 4, "--out", "x.svg", "--labels")
    out = show_json(command, small_net, *options)
    assert len(out["sensors"]["never_observed"]) == 2
    assert out["sensors"]["source"] == "kriging 30 %, seed 4"
    expected = {"always-observed": 4, "never-observed": 2}
    assert marks(command.cwd / "x.svg") == expected


def test_the_picture_shows_lasting_faults(command, small_net):
    options = ("--missing", "lane", "--lasting", "--rate", 0.25, "--out", "x.svg")
    sensors = show_json(command, small_net, *options)["sensors"]
    assert sensors["source"] == "lane (lasting) 25 %, seed 0"
    assert sensors["missing_share"] == 0.25
    assert sensors["partly_observed"] + len(sensors["never_observed"]) > 1


def test_a_run_and_its_mask_show_the_same(command, small_net):
    options = ("--missing", "kriging", "--rate", 0.5, "--horizon", 150)
    done = command("run", "--net", small_net, *options, "--out", "run")
    assert done.returncode == 0, done.stderr
    by_run = show_json(command, small_net, "--run", "run", "--out", "a.svg")
    by_mask = show_json(command, small_net, "--mask", "run/mask.npz", "--out", "b.svg")
    drawn = show_json(command, small_net, "--missing", "kriging", "--rate", 0.5, "--out", "c.svg")
    assert by_run["sensors"]["steps"] == by_mask["sensors"]["steps"] == 10
    found = [out["sensors"]["never_observed"] for out in (by_run, by_mask, drawn)]
    assert len(found[0]) == 3
    assert found[0] == found[1] == found[2]
    assert marks(command.cwd / "a.svg") == {"always-observed": 3, "never-observed": 3}


def test_a_network_without_demand(command, tmp_path):
    roadnet, _ = write(tmp_path, grid_roadnet(1, 2), [])
    import_cityflow(roadnet, None, tmp_path / "bare", "bare", 600)
    assert show_json(command, tmp_path / "bare", "--out", "x.png")["demand"] is None
    done = command("net", "show", tmp_path / "bare")
    assert done.returncode == 0, done.stderr
    assert "demand" in done.stdout
    words = ["without a demand"]
    refused(command, "net", "show", tmp_path / "bare", "--demand", "recorded", words=words)


def test_one_intersection_whose_demand_is_shorter(command):
    shape = ("--rows", 1, "--columns", 1, "--horizon", 600)
    done = command("net", "generate", *shape, "--out", "one")
    assert done.returncode == 0, done.stderr
    done = command("net", "show", "one")
    assert done.returncode == 0, done.stderr
    assert "vehicles in 600 s, generated" in done.stdout
    assert "phases of 1 intersection\n" in done.stdout
    assert show_json(command, "one", "--horizon", 300)["demand"]["horizon"] == 300
    show_json(command, "one", "--out", "x.svg")
    assert "1 intersection, 8 roads" in (command.cwd / "x.svg").read_text()


def test_one_intersection_that_differs(command):
    shape = ("--rows", 1, "--columns", 3, "--remove", "1,1-1,2")
    done = command("net", "generate", *shape, "--out", "tee")
    assert done.returncode == 0, done.stderr
    shown = command("net", "show", "tee").stdout
    assert "\n1 intersection has other phases (1 kind; --phases lists them)\n" in shown
    shown = command("net", "show", "tee", "--phases").stdout
    ids = [kind["ids"] for kind in show_json(command, "tee")["network"]["signals"]]
    assert sorted(name for kind in ids for name in kind) == [
        *("intersection_1_1", "intersection_2_1", "intersection_3_1"),
    ]
    for kind in ids:
        assert f"\nphases of {counted(len(kind), 'intersection')}: {', '.join(kind)}\n" in shown
    assert "other phases" not in shown
    shown = command("net", "show", "tee", "--lanes").stdout
    movements = show_json(command, "tee")["network"]["movements"]
    net = sumolib.net.readNet(str(command.cwd / "tee" / "net.net.xml"))
    for one in movements:
        words = f"\n{one['intersection']}  {one['movement']}  {' '.join(one['lanes'])}\n"
        assert words in shown
        ends = {net.getLane(lane).getEdge().getToNode().getID() for lane in one["lanes"]}
        assert ends == {one["intersection"]}
    assert len(movements) < 36  # two roads are gone


def test_an_older_picture_is_replaced(command, small_net):
    (command.cwd / "x.png").write_text("old")
    show_json(command, small_net, "--out", "x.png")
    assert (command.cwd / "x.png").read_bytes().startswith(b"\x89PNG")
    assert [path.name for path in command.cwd.iterdir()] == ["x.png"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--out", "x.jpg"], ["--out", "x.jpg", ".pdf, .png, .svg"]),
        (["--out", "picture"], ["--out", "picture", ".png"]),
        (["--out", "no/x.png"], ["--out", "no/x.png", "no folder"]),
        (["--missing", "krigin", "--rate", "0.1"], ["krigin", "did you mean kriging?"]),
        (["--missing", "lane"], ["--rate", "lane"]),
        (["--rate", "0.5"], ["--rate", "--missing"]),
        (["--missing", "kriging", "--rate", "0.9"], ["0.9", "at most", "adjacent"]),
        (["--missing", "lane", "--rate", "0.1", "--mask", "m.npz"], ["--mask", "--missing"]),
        (["--mask", "m.npz", "--run", "r"], ["--run", "--mask"]),
        (["--mask", "none.npz"], ["mask", "none.npz"]),
        (["--run", "nowhere"], ["--run", "nowhere", "run.json"]),
        (["--demand", "some"], ["--demand", "some", "recorded"]),
        (["--seed", "-1"], ["--seed", "-1"]),
        (["--frobnicate"], ["--frobnicate"]),
    ],
)
def test_bad_input(command, small_net, arguments, words):
    refused(command, "net", "show", small_net, *arguments, words=words)


def test_networks_that_are_not_there(command):
    refused(command, "net", "show", "jinann", words=["jinann", "jinan"])
    refused(command, "net", "show", "no/such", words=["no/such"])
    refused(command, "net", "show", words=["NET"])


def test_places_that_cannot_be_written(command, small_net):
    (command.cwd / "there.png").mkdir()
    (command.cwd / "file").write_text("")
    for out, why in (("there.png", "folder"), ("file/x.png", "no folder"), ("/proc/x.png", "")):
        refused(command, "net", "show", small_net, "--out", out, words=["--out", out, why])


def test_a_mask_of_another_network(command, small_net, tmp_path):
    roadnet, _ = write(tmp_path, grid_roadnet(1, 2), [])
    import_cityflow(roadnet, None, tmp_path / "other", "other", 600)
    done = command("run", "--net", small_net, "--horizon", 60, "--out", "run")
    assert done.returncode == 0, done.stderr
    words = ["mask", "other intersections"]
    refused(command, "net", "show", tmp_path / "other", "--run", "run", words=words)
    (command.cwd / "run" / "mask.npz").unlink()
    words = ["--run", "mask.npz"]
    refused(command, "net", "show", small_net, "--run", "run", words=words)
