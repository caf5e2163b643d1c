"""Whatever a user gets wrong is one line, status 2, and leaves nothing behind."""

import json
import os

import pytest

from tests.cityflow_files import flow, grid_flows, grid_roadnet, road, write
from tests.cli.refusals import refused
from tsc_missing.errors import UserError
from tsc_missing.files import check_writable


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--net", "jinann"], ["--net: jinann", "did you mean jinan"]),
        (["--net", "no/such/folder"], ["no/such/folder"]),
        (["--net", "/proc/self"], ["--net: /proc/self is not", "no manifest.json"]),
        (["--controller", "max-queu"], ["--controller: max-queu", "did you mean max-queue?"]),
        (["--imputer", "sfn"], ["--imputer: sfn", "did you mean sfm?"]),
        (["--blind", "fixed"], ["--blind: fixed", "fixed-time"]),
        (["--missing", "krigin", "--rate", "0.1"], ["krigin", "did you mean kriging?"]),
        (["--missing", "krigin"], ["--missing", "did you mean kriging?"]),
        (["--missing", "fil", "--rate", "0.1"], ["allowed: burst, kriging, lane, mixed, none,"]),
        (["--missing", "random", "--rate", "1.5"], ["--rate", "1.5", "less than or equal to 1"]),
        (["--missing", "random", "--rate", "-0.1"], ["--rate", "-0.1"]),
        (["--missing", "random", "--rate", "nan"], ["--rate", "nan"]),
        (["--missing", "random", "--rate", "many"], ["rate", "many"]),
        (["--missing", "random"], ["--rate", "random"]),
        (["--rate", "0.5"], ["--rate", "--missing"]),
        (["--missing", "kriging", "--rate", "0.9"], ["--rate: 0.9", "at most", "adjacent"]),
        (["--missing", "burst", "--rate", "0.95", "--mean-outage", "2"], ["--rate: 0.95", "2"]),
        (
            ["--missing", "random", "--rate", "0.2", "--mean-outage", "9"],
            ["--mean-outage: 9", "burst"],
        ),
        (["--mask", "none.npz"], ["--mask: none.npz"]),
        (["--mask", "m.npz", "--missing", "random", "--rate", "0"], ["--rate: 0", "--mask"]),
        (["--mask", "m.npz", "--mask-seed", "1"], ["--mask-seed: 1", "--mask"]),
        (["--mask", "m.npz", "--missing", "random"], ["--missing: random", "--mask"]),
        (["--mask", "m.npz", "--adjacent"], ["--adjacent: set", "--mask"]),
        (["--missing", "file", "--rate", "0.1"], ["--missing: file", "--mask FILE"]),
        (["--volume", "0"], ["--volume", "0"]),
        (["--volume", "nan"], ["--volume", "nan"]),
        (["--horizon", "0"], ["--horizon"]),
        (["--yellow", "15"], ["--yellow: 15 is not allowed", "decision_interval"]),
        (["--decision-interval", "5"], ["--decision-interval: 5", "the yellow takes 5 s"]),
        (["--all-red", "30"], ["--all-red: 30 is not allowed", "decision_interval, 15 s"]),
        (["--all-red", "10"], ["--all-red: 10 is not allowed", "the yellow takes 5 s"]),
        (["--missing", "random", "--rate", "0.4", "--adjacent"], ["--adjacent: True", "kriging"]),
        (["--missing", "random", "--rate", "0.4", "--lasting"], ["--lasting: True", "lane"]),
        (["--lasting"], ["--lasting: True", "lane"]),
        (["--mask", "m.npz", "--lasting"], ["--lasting: set", "--mask"]),
        (["--sensor", "radar"], ["--sensor", "radar", "area"]),
        (["--detector-length", "20"], ["--detector-length: 20", "--sensor area"]),
        (["--sensor", "area", "--detector-length", "-5"], ["--detector-length", "-5"]),
        (["--sensor", "area", "--detector-length", "1.9"], ["--detector-length: 1.9", "2"]),
        (["--seed", "-1"], ["--seed", "-1"]),
        (["--demand", "recorded", "--net", "jinan_1"], ["jinan_1", "tsc-net import"]),
        (["--frobnicate"], ["--frobnicate"]),
    ],
)
def test_tsc_run(command, arguments, words):
    refused(command, "run", *arguments, words=words)


def test_output_folders_that_cannot_be_written(command, small_net):
    (command.cwd / "there").mkdir()
    (command.cwd / "there" / "something").write_text("")
    (command.cwd / "file").write_text("")
    for out in ("there", "file", "file/below"):
        refused(command, "run", "--net", small_net, "--out", out, words=[f"--out: {out}"])


def test_output_folders_whose_place_nothing_can_take(command, small_net, tmp_path):
    (tmp_path / "empty").mkdir()
    (command.cwd / "link").symlink_to(tmp_path / "empty")
    (command.cwd / "dangling").symlink_to(tmp_path / "none")
    for out, words in ((".", "current folder"), ("link", "a link"), ("dangling", "a link")):
        refused(command, "run", "--net", small_net, "--out", out, words=[f"--out: {out}", words])


def test_a_mount_is_no_output_folder(tmp_path, monkeypatch):
    monkeypatch.setattr("os.path.ismount", lambda path: path == tmp_path)
    with pytest.raises(UserError, match="a file system is mounted"):
        check_writable(tmp_path, "out")


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write anywhere")
def test_output_without_permission(command, small_net):
    locked = command.cwd / "locked"
    locked.mkdir(mode=0o500)
    refused(command, "run", "--net", small_net, "--out", locked / "x", words=["permission"])


def test_a_mask_of_another_network(command, small_net):
    done = command("run", "--net", small_net, "--horizon", 150, "--out", "a")
    assert done.returncode == 0, done.stderr
    mask = command.cwd / "a" / "mask.npz"
    words = ["mask", "mask.npz"]
    refused(command, "run", "--net", "jinan", "--mask", mask, words=words)
    refused(command, "run", "--net", small_net, "--mask", mask, words=[*words, "40"])
    cut = command.cwd / "cut.npz"
    cut.write_bytes(mask.read_bytes()[:200])
    refused(command, "run", "--net", small_net, "--mask", cut, words=["mask", "cut.npz"])


def no_signals(net):
    for node in net["intersections"]:
        node["trafficLight"] = None


def wrong_lane(net):
    node = next(i for i in net["intersections"] if i["roadLinks"])
    node["roadLinks"][0]["laneLinks"][0]["startLaneIndex"] = 9


def wrong_link(net):
    node = next(i for i in net["intersections"] if i["roadLinks"])
    node["trafficLight"]["lightphases"][1]["availableRoadLinks"].append(99)


def wrong_type(net):
    node = next(i for i in net["intersections"] if i["roadLinks"])
    node["roadLinks"][0]["type"] = "jump"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (no_signals, ["no intersection in it has signals"]),
        (wrong_lane, ["lane link 9"]),
        (wrong_link, ["road link 99"]),
        (wrong_type, ["'jump'", "go_straight"]),
        (lambda net: net.pop("roads"), ["roads", "Field required"]),
        (lambda net: net["roads"].pop(), ["unknown road"]),
    ],
)
def test_bad_road_networks(command, tmp_path, change, words):
    content = grid_roadnet(1, 2)
    change(content)
    roadnet, flows = write(tmp_path, content, grid_flows(1, 2))
    arguments = ("--roadnet", roadnet, "--flow", flows, "--out", "net")
    refused(command, "net", "import", *arguments, words=["roadnet", *words])


UNKNOWN = flow([road(0, 1, 0), "road_9_9_9"], 0)
APART = flow([road(0, 1, 0), road(2, 1, 2)], 0)
EARLY = {**flow([road(0, 1, 0)], 0), "startTime": -5}
BACKWARD = flow([road(0, 1, 0)], 10, 5)


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ([UNKNOWN], ["unknown road road_9_9_9"]),
        ([APART], ["no movement leads from"]),
        ([EARLY], ["startTime"]),
        ([BACKWARD], ["endTime 5 is before startTime 10"]),
        ([{"vehicle": {}}], ["0.route"]),
        ([], ["no vehicle"]),
        ({"not": "a list"}, ["list"]),
    ],
)
def test_bad_flows(command, tmp_path, entries, words):
    roadnet, flows = write(tmp_path, grid_roadnet(1, 2), entries)
    arguments = ("--roadnet", roadnet, "--flow", flows, "--out", "net")
    refused(command, "net", "import", *arguments, words=["flow", *words])


@pytest.mark.parametrize("content", ["{", '[{"route": ["a"', "no JSON", "\x00\xff"])
def test_truncated_and_non_json_files(command, tmp_path, content):
    roadnet, flows = write(tmp_path, grid_roadnet(1, 1), [])
    flows.write_bytes(content.encode("latin-1"))
    options = ("--roadnet", roadnet, "--flow", flows, "--out", "net")
    refused(command, "net", "import", *options, words=["flow"])
    options = ("--roadnet", flows, "--out", "net")
    refused(command, "net", "import", *options, words=["roadnet"])


def test_import_needs_a_place(command, small_files):
    roadnet, flows = small_files
    both = ("--roadnet", roadnet, "--flow", flows)
    refused(command, "net", "import", *both, words=["--as", "--out"])
    refused(command, "net", "import", *both, "--as", "a/b", words=["a/b"])
    refused(command, "net", "import", "--roadnet", "none.json", "--out", "x", words=["none.json"])


def test_names_of_bundled_networks_stay_theirs(command, small_files, tmp_path):
    roadnet, _ = small_files
    for make in (("import", "--roadnet", roadnet), ("generate", "--rows", 1, "--columns", 2)):
        words = ["--as: jinan is not allowed", "the bundled jinan_1"]
        refused(command, "net", *make, "--as", "jinan", words=words)
        words = ["--as: hangzhou_2 is not allowed", "16 intersections from intersection_1_1"]
        refused(command, "net", *make, "--as", "hangzhou_2", words=words)
    sumo = command("net", "import", "--roadnet", roadnet, "--out", tmp_path / "jinan_1")
    assert sumo.returncode == 0, sumo.stderr
    net = tmp_path / "jinan_1" / "net.net.xml"
    words = ["--as: jinan_1 is not allowed", "12 intersections"]
    refused(command, "net", "import", "--sumo-net", net, "--as", "jinan_1", words=words)
    assert not list((tmp_path / "data").rglob("*"))


def test_network_folders_that_are_not_whole(command, small_net, tmp_path):
    broken = tmp_path / "broken"
    broken.mkdir()
    for file in small_net.iterdir():
        (broken / file.name).write_bytes(file.read_bytes())
    (broken / "network.json").write_text("{}")
    refused(command, "run", "--net", broken, words=["network.json", "checksum"])
    (broken / "network.json").unlink()
    refused(command, "run", "--net", broken, words=["network.json", "missing"])
    manifest = json.loads((broken / "manifest.json").read_text())
    (broken / "manifest.json").write_text(json.dumps({**manifest, "colour": "red"}))
    refused(command, "run", "--net", broken, words=["manifest.json", "colour"])
