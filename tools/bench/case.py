"""What is simulated: a net, its routes, and the signal plan that a controller made of them."""

import importlib.util
import json
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tools.bench.processes import BenchError

CASE = "case.json"


@dataclass(frozen=True)
class Wanted:
    """What a benchmark was asked to run."""

    net: str
    demand: str
    horizon: int
    seed: int


@dataclass(frozen=True)
class Case:
    """A controller's run, written down so that other programs can repeat its traffic.

    ``plan`` holds the signal states that the controller's run sent, as a static SUMO program;
    ``phases_net`` is the net with each signal's green phases as its program; ``phases`` are the
    phases by decision step and signal.
    """

    wanted: Wanted
    controller: str
    folder: Path
    content: dict[str, Any]

    @property
    def ours(self) -> list[str]:
        """``tsc-run``'s command line up to ``--out``, which must follow."""
        script = Path(sys.executable).with_name("tsc-run")
        found = [str(script)] if script.exists() else [sys.executable, "-m", "tsc_missing.cli.run"]
        return [*found, *self.options]

    @property
    def options(self) -> list[str]:
        """``tsc-run``'s options up to ``--out``."""
        return [
            f"--net={self.wanted.net}",
            f"--demand={self.wanted.demand}",
            f"--horizon={self.wanted.horizon}",
            f"--seed={self.wanted.seed}",
            f"--controller={self.controller}",
            "--missing=none",
            "--no-decisions",
            "--json",
        ]

    def sumo_arguments(self, *additional: str) -> list[str]:
        """SUMO's own arguments for the same traffic, without any output that is not asked for."""
        return [
            f"--net-file={self.content['net']}",
            f"--route-files={self.content['routes']}",
            f"--additional-files={','.join((self.content['plan'], *additional))}",
            f"--seed={self.wanted.seed}",
            *self.content["options"],
        ]

    @property
    def end(self) -> str:
        """The option that ends a bare simulation at the horizon."""
        return f"--end={self.wanted.horizon}"


def make_case(wanted: Wanted, controller: str, folder: Path) -> Case:
    """Run the controller once in a process of its own, and write down what it did."""
    run_module(
        "record",
        f"--net={wanted.net}",
        f"--demand={wanted.demand}",
        f"--horizon={wanted.horizon}",
        f"--seed={wanted.seed}",
        f"--controller={controller}",
        f"--folder={folder}",
    )
    return Case(wanted, controller, folder, json.loads((folder / CASE).read_text("utf-8")))


def run_module(name: str, *arguments: str) -> str:
    """What a module of ``tools.bench.programs`` prints; ``BenchError`` if it fails."""
    command = [sys.executable, "-m", f"tools.bench.programs.{name}", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise BenchError(f"{name}: {done.stderr.strip() or done.stdout.strip()}")
    return done.stdout


def sumo_home() -> Path:
    """The folder of the installed simulator; ``BenchError`` says how to install it."""
    found = importlib.util.find_spec("sumo")
    folders = list(found.submodule_search_locations or ()) if found is not None else []
    if folders:
        return Path(folders[0])
    raise BenchError("the sumo program is not installed: pip install 'tsc-missing[sumo]'")


def sumo_program() -> str:
    """The simulator's own executable, not the Python script that pip puts in front of it."""
    program = shutil.which("sumo", path=str(sumo_home() / "bin"))
    if program is None:
        raise BenchError(f"there is no sumo program in {sumo_home() / 'bin'}")
    return program
