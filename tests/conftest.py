"""Settings of all tests, and the small imported network that several of them run."""

import importlib.util
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest
from hypothesis import settings

from tests.cityflow_files import grid_flows, grid_roadnet, write
from tests.kept_workers import Lend, kept_worker
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


@pytest.fixture(scope="module")
def weights_read_once() -> Iterator[None]:
    """Weights of Q-networks that a module's tests share: reading them takes longer than using."""
    with pytest.MonkeyPatch.context() as patch:
        if importlib.util.find_spec("torch") is not None:
            from tsc_missing.qlearning import controller

            patch.setattr(controller, "load_q_network", cache(controller.load_q_network))
        yield


@pytest.fixture(scope="module")
def lend() -> Iterator[Lend]:
    """One process that plays the episodes of all of a module's trainings."""
    with kept_worker() as lend:
        yield lend


@pytest.fixture
def one_worker(lend: Lend, monkeypatch: pytest.MonkeyPatch) -> None:
    """Trainings borrow that process; not for tests that stop one in the middle of its episodes."""
    monkeypatch.setattr("tsc_missing.lookahead.training.worker_processes", lend)
    monkeypatch.setattr("tsc_missing.qlearning.online.worker_processes", lend)


@pytest.fixture
def command(tmp_path) -> Command:
    """Runs ``tsc-<name> arguments`` as a user does, in an empty folder with an empty data folder.

    ``command.cwd`` is that folder. ``command.start`` does not wait: it gives the process, which
    listens to Ctrl-C as in a terminal (a background shell starts its processes deaf to it).
    """
    cwd = tmp_path / "cwd"
    cwd.mkdir()

    environment = {**os.environ, "XDG_DATA_HOME": str(tmp_path / "data")}

    def words(name: str, arguments: tuple[object, ...]) -> list[str]:
        return [sys.executable, "-m", f"tsc_missing.cli.{name}", *map(str, arguments)]

    def run(name: str, *arguments: object, **options: object) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            words(name, arguments),
            cwd=cwd,
            env=environment,
            capture_output=True,
            text=True,
            timeout=300,
            **options,
        )

    def start(name: str, *arguments: object, **variables: str) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            words(name, arguments),
            cwd=cwd,
            env={**environment, **variables},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )

    run.cwd = cwd  # type: ignore[attr-defined]
    run.start = start  # type: ignore[attr-defined]
    return run
