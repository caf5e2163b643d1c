"""Runs ``tsc-run`` with its stages timed; the arguments are tsc-run's. Prints JSON.

A stage is a function; what other stages take inside it counts for them. ``memory`` is by how much
the peak resident set rose in it.
"""

import functools
import importlib
import json
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from typing import Any

from tools.bench.processes import MEGABYTE, UNIT

STAGES = (
    "tsc_missing.evaluation.scenario:read_folder",
    "tsc_missing.evaluation.scenario:Scenario.demand",
    "tsc_missing.evaluation.run:mask_of",
    "tsc_missing.evaluation.closed_loop:_write_inputs",
    "tsc_missing.evaluation.closed_loop:control_context",
    "tsc_missing.controllers.fallback:Safe.reset",
    "tsc_missing.simulation.engine:Simulation._start",
    "tsc_missing.simulation.detectors:Detectors.__init__",
    "tsc_missing.simulation.detectors:Detectors.read",
    "tsc_missing.evaluation.steps:apply_mask",
    "tsc_missing.controllers.fallback:Safe.decide",
    "tsc_missing.simulation.signals:Signals.__init__",
    "tsc_missing.simulation.signals:Signals.command",
    "tsc_missing.simulation.signals:Signals.release",
    "tsc_missing.simulation.engine:Simulation.advance",
    "tsc_missing.simulation.engine:Simulation.__exit__",
    "tsc_missing.evaluation.metrics:read_trips",
    "tsc_missing.evaluation.metrics:read_lanes",
    "tsc_missing.evaluation.metrics:summarise",
    "tsc_missing.evaluation.run:versions",
    "tsc_missing.evaluation.run:git_revision",
    "tsc_missing.evaluation.movements:measure_movements",
    "tsc_missing.evaluation.run:_write",
)


@dataclass
class Stage:
    """What a stage took, without the stages inside it."""

    stage: str
    calls: int = 0
    wall: float = 0.0  # [s]
    cpu: float = 0.0  # [s]
    memory: float = 0.0  # [MB]


@dataclass
class Clock:
    """Shares out wall time, CPU time and growth of the peak memory to one stage at a time."""

    stages: dict[str, Stage] = field(default_factory=dict)
    stack: list[str] = field(default_factory=lambda: ["everything else"])
    last: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def switch(self) -> None:
        """Charge what has passed since the last switch to the stage on top of the stack."""
        now = (time.perf_counter(), time.process_time(), _peak())
        stage = self.stages.setdefault(self.stack[-1], Stage(self.stack[-1]))
        stage.wall += now[0] - self.last[0]
        stage.cpu += now[1] - self.last[1]
        stage.memory += now[2] - self.last[2]
        self.last = now

    def enter(self, name: str) -> None:
        """Begin a stage."""
        self.switch()
        self.stack.append(name)
        self.stages.setdefault(name, Stage(name)).calls += 1

    def leave(self) -> None:
        """End the stage that began last."""
        self.switch()
        self.stack.pop()

    def timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function as a stage."""

        @functools.wraps(function)
        def stage(*args: Any, **kwargs: Any) -> Any:
            self.enter(name)
            try:
                return function(*args, **kwargs)
            finally:
                self.leave()

        return stage


def _peak() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * UNIT / MEGABYTE


def _patch(clock: Clock, place: str) -> None:
    module, _, path = place.partition(":")
    *owners, name = path.split(".")
    owner = functools.reduce(getattr, owners, importlib.import_module(module))
    setattr(owner, name, clock.timed(path, getattr(owner, name)))


def main(arguments: list[str]) -> None:
    """Run the command and print its stages."""
    clock = Clock()
    clock.last = (time.perf_counter(), time.process_time(), 0.0)
    clock.enter("Python and this program")
    clock.leave()
    clock.enter("importing tsc-run")
    from tsc_missing.cli.run import app

    clock.leave()
    for place in STAGES:
        _patch(clock, place)
    with tempfile.TemporaryDirectory() as scratch, redirect_stdout(StringIO()):
        app([*arguments, f"--out={Path(scratch, 'out')}"], standalone_mode=False)
    clock.switch()
    json.dump([vars(stage) for stage in clock.stages.values()], sys.stdout)


if __name__ == "__main__":
    main(sys.argv[1:])
