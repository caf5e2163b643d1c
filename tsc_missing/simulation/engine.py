"""The SUMO process: libsumo inside this process, or sumo and sumo-gui over TraCI."""

import contextlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar, Literal, Self

from tsc_missing.errors import UserError

EngineName = Literal["libsumo", "traci", "gui"]

OPTIONS = (
    "--step-length=1",
    "--time-to-teleport=-1",
    "--collision.action=warn",
    "--no-step-log",
    "--no-warnings",
    "--duration-log.disable",
    "--xml-validation=never",
    "--xml-validation.net=never",
)


@dataclass(frozen=True)
class Inputs:
    """The files of a simulation, and the time [s] of SUMO's clock that it begins at."""

    net: Path
    routes: Path
    additional: tuple[Path, ...] = ()
    begin: float = 0.0


class SimulationError(RuntimeError):
    """SUMO refused its input or stopped; the text is SUMO's own."""


class Simulation:
    """One SUMO simulation as a context manager.

    libsumo holds one simulation a process; a second one raises instead of silently replacing the
    first. ``api`` is libsumo's or TraCI's module-like interface.
    """

    _running: ClassVar[bool] = False

    def __init__(
        self,
        inputs: Inputs,
        outputs: Sequence[str] = (),
        engine: EngineName = "libsumo",
        seed: int = 0,
    ) -> None:
        """``outputs`` are further SUMO options, as ``--tripinfo-output=FILE``."""
        for path in (inputs.routes, *inputs.additional):
            if "," in str(path):  # between the files of a list
                raise UserError("path", path, "SUMO reads no list of files with a comma in it")
        self._inputs = inputs
        self._engine: EngineName = engine
        self._log = inputs.routes.with_name("sumo-errors.log")
        self._options = [
            f"--net-file={inputs.net}",
            f"--route-files={inputs.routes}",
            f"--seed={seed}",
            *OPTIONS,
            *outputs,
        ]
        if inputs.begin:
            self._options.append(f"--begin={inputs.begin:.2f}")
        if inputs.additional:
            self._options.append(f"--additional-files={','.join(map(str, inputs.additional))}")
        self._errors = -1  # the log's descriptor while it runs
        self.api: Any = None

    def __enter__(self) -> Self:
        if Simulation._running:
            raise SimulationError(
                "a simulation is already running in this process; close it first, or use another "
                "process (libsumo holds one simulation a process)"
            )
        self._errors = os.open(self._log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND)
        try:
            with _stderr_to(self._errors):
                self.api = self._start()
        except BaseException as error:
            os.close(self._errors)
            if isinstance(error, Exception):
                raise SimulationError(self._reason(error)) from error
            raise
        Simulation._running = True
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        Simulation._running = False
        try:
            with _stderr_to(self._errors):
                self.api.close()
        finally:
            os.close(self._errors)

    def _start(self) -> Any:
        if self._engine == "libsumo":
            import libsumo

            try:
                libsumo.start(["sumo", *self._options])
            except Exception:
                if libsumo.isLoaded():
                    libsumo.close()
                raise
            return libsumo
        return _start_traci(self._engine, self._options)

    def advance(self, until: float) -> None:
        """Simulate up to ``until`` [s] after the begin."""
        self._call(self.api.simulationStep, float(self._inputs.begin + until))

    def save(self, path: Path) -> None:
        """Write the state of the traffic to a file, to go back to it with ``restore``.

        Not quite all of it: a vehicle that waits to enter may enter later after a restore. With
        the state of the random numbers saved too (``--save-state.rng``) more went otherwise.
        """
        self._call(self.api.simulation.saveState, str(path))

    def restore(self, path: Path) -> None:
        """Go back to a saved state; the signals must then be set again.

        Trips that end after it are in SUMO's outputs as often as they are simulated.
        """
        self._call(self.api.simulation.loadState, str(path))

    def _call(self, call: Callable[..., Any], *arguments: Any) -> None:
        try:
            with _stderr_to(self._errors):
                call(*arguments)
        except Exception as error:
            raise SimulationError(self._reason(error)) from error

    def _reason(self, error: Exception) -> str:
        text = ""
        with contextlib.suppress(OSError):
            text = self._log.read_text(encoding="utf-8", errors="replace")
        lines = [line.strip() for line in text.splitlines() if line.strip()]
        wanted = [line for line in lines if not line.startswith("Quitting")]
        return f"SUMO: {' '.join(wanted[:3]) or error}"


def _start_traci(engine: EngineName, options: Sequence[str]) -> Any:
    from tsc_missing.network.netconvert import sumo_tool

    try:
        import traci
    except ImportError:
        raise UserError(
            "program",
            "traci",
            "pip install 'tsc-missing[sumo]' brings it",
            verdict="is not installed",
        ) from None
    program = sumo_tool("sumo-gui" if engine == "gui" else "sumo")
    extra = ["--start", "--quit-on-end"] if engine == "gui" else []
    with contextlib.redirect_stdout(sys.stderr):
        traci.start([program, *options, *extra], label="tsc-missing", stdout=subprocess.DEVNULL)
    return traci.getConnection("tsc-missing")


@contextlib.contextmanager
def _stderr_to(target: int) -> Iterator[None]:
    """What SUMO itself writes to the error stream goes to an open file, not to the terminal."""
    sys.stderr.flush()
    saved = os.dup(2)
    try:
        os.dup2(target, 2)
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
