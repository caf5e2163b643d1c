"""``--version`` of every command."""

import pytest

from tsc_missing.versions import versions

NAMES = ("run", "net", "collect", "train", "batch", "report", "compare", "check")


@pytest.mark.parametrize("name", NAMES)
def test_every_command_says_its_version(command, name):
    done = command(name, "--version")
    assert (done.returncode, done.stderr) == (0, "")
    said = dict(pair.split(" ") for pair in done.stdout.split(" ", 1)[1].strip().split(", "))
    assert done.stdout.startswith(f"tsc-{name} ")
    assert said == versions()
