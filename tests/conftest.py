"""Settings of all tests, and the small imported network that several of them run."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

from tests.cityflow_files import grid_flows, grid_roadnet, write
from tsc_missing.network.importing import import_cityflow

settings.register_profile("shared-machine", deadline=None)
settings.load_profile("shared-machine")

Command = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="session")
def small_files(tmp_path_factory) -> tuple[Path, Path]:
    """CityFlow files of a 2 x 3 grid with ten minutes of traffic."""
    folder = tmp_path_factory.mktemp("cityflow")
    return write(folder, grid_roadnet(2, 3), grid_flows(2, 3))


@pytest.fixture(scope="session")
def small_net(small_files, tmp_path_factory) -> Path:
    """The network folder imported from them."""
    target = tmp_path_factory.mktemp("networks") / "small"
    import_cityflow(*small_files, target, "small", 600)
    return target


@pytest.fixture
def command(tmp_path) -> Command:
    """Runs ``tsc-<name> arguments`` as a user does, in an empty folder with an empty data folder.

    ``command.cwd`` is that folder.
    """
    cwd = tmp_path / "cwd"
    cwd.mkdir()

    def run(name: str, *arguments: object, **options: object) -> "subprocess.CompletedProcess[str]":
        environment = {**os.environ, "XDG_DATA_HOME": str(tmp_path / "data")}
        return subprocess.run(
            [sys.executable, "-m", f"tsc_missing.cli.{name}", *map(str, arguments)],
            cwd=cwd,
            env=environment,
            capture_output=True,
            text=True,
            timeout=300,
            **options,
        )

    run.cwd = cwd  # type: ignore[attr-defined]
    return run
