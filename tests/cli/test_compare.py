"""``tsc-compare`` as it is used, on run folders of the real ``tsc-run``."""

import json
from pathlib import Path

import pytest

from tests.cli.refusals import refused
from tsc_missing.cli.compare import compare
from tsc_missing.errors import UserError

PNG = b"\x89PNG\r\n"


@pytest.fixture
def two(command, small_net):
    """The names of two run folders, one with two of six intersections blind."""
    options = ("--net", small_net, "--horizon", 300, "--controller", "max-queue")
    for name, more in (("whole", ()), ("blind", ("--missing", "kriging", "--rate", 0.34))):
        done = command("run", *options, *more, "--out", name)
        assert done.returncode == 0, done.stderr
    return "whole", "blind"


def test_two_runs_beside_each_other(command, two):
    done = command("compare", *two, "--rows", 4, "--csv", "by.csv", "--picture", "map.png")
    assert (done.returncode, done.stderr) == (0, "")
    for words in (
        "1  whole  (small, recorded demand, max-queue)",
        "missing.pattern  none → kriging",
        "missing.rate     0.0 → 0.34",
        "4 of 6 intersections whose delay changed most",
        "100 → 0 %",
        "written to by.csv and map.png",
    ):
        assert words in done.stdout
    assert "warning" not in done.stdout
    lines = done.stdout.splitlines()
    assert len([line for line in lines if line.startswith("intersection_")]) == 4
    assert (command.cwd / "by.csv").read_text().count("\n") == 1 + 6
    assert (command.cwd / "map.png").read_bytes().startswith(PNG)
    alone = command("compare", two[1], "--each", "movement", "--rows", 0).stdout
    assert "72 movements, the worst first" in alone
    assert "differs" not in alone
    found = json.loads(command("compare", *two, "--json").stdout)
    assert [run["folder"] for run in found["runs"]] == list(two)
    (command.cwd / two[1] / "movements.parquet").unlink()
    words = ["run: ", two[1], "movements.parquet", "run it again"]
    refused(command, "compare", *two, "--csv", "other.csv", words=words)


def test_what_is_no_run_folder(command):
    refused(command, "compare", "nowhere", words=["run: nowhere", "run.json"])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"rows": -1}, "rows: -1 is not allowed; it must be 0"),
        ({"each": "lane"}, "each: lane is not allowed; allowed: intersection, movement"),
        ({"csv": "no/by.csv"}, "csv: no/by.csv is not allowed; there is no folder"),
        ({"picture": "map.bmp"}, "picture: map.bmp is not allowed; it must end in"),
        ({"picture": "map.png"}, "picture: map.png cannot show 3 runs"),
    ],
)
def test_bad_options(tmp_path, options, words):
    paths = {key: Path(it) for key, it in options.items() if key in ("csv", "picture")}
    with pytest.raises(UserError) as caught:
        compare([tmp_path] * 3, **{**options, **paths})
    assert str(caught.value).startswith(words)
