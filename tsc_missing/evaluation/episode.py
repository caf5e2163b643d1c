"""One run whose phases are told from outside, step by step."""

import contextlib
import tempfile
import time
from pathlib import Path

import numpy as np

from tsc_missing.config import RunSettings
from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.registry import ruled
from tsc_missing.evaluation.closed_loop import control_context, simulating
from tsc_missing.evaluation.metrics import Result, read_outputs, summarise
from tsc_missing.evaluation.steps import Scene, Stepper, Trace
from tsc_missing.imputation.base import Imputer
from tsc_missing.network.model import FloatArray, IntArray
from tsc_missing.sensing.observation import Measurement, Observation
from tsc_missing.simulation.engine import EngineName
from tsc_missing.simulation.outputs import OutputFiles


class Told(Controller):
    """The phases that it was told last, and what who told them took the roads to hold."""

    needs_values = False
    phases: IntArray
    believed: FloatArray | None

    def reset(self, context: ControlContext) -> None:
        """Forget them."""
        self.phases = np.zeros(context.network.n, dtype=np.int64)
        self.believed = None

    def decide(self, observation: Observation) -> IntArray:
        """(N,): what it was told."""
        return self.phases

    def estimates(self) -> FloatArray | None:
        """(N, 12, F): filled values; the maximum red goes by them where no sensor reports."""
        return self.believed


class Episode:
    """A simulation at the start of a decision step, until it is closed.

    ``truth`` and ``observation`` are of now, at the end of the run, too.
    """

    truth: Measurement
    observation: Observation

    def __init__(
        self,
        scene: Scene,
        settings: RunSettings,
        imputer: Imputer | None,
        engine: EngineName = "libsumo",
    ) -> None:
        """Start it, and observe; an ``imputer`` fills what is missing."""
        self._began, self._horizon = time.perf_counter(), settings.horizon
        self._scene, self._trace, self._told = scene, Trace.empty(scene.mask), Told()
        blind = "none" if settings.blind == "auto" else settings.blind
        space, red = settings.signals.min_space or 0, settings.signals.max_red
        self._rules = ruled(self._told, blind, space, red)
        self._imputer = imputer
        context = control_context(scene, settings)
        self._rules.reset(context)
        if imputer is not None:
            imputer.reset(context)
        with contextlib.ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="tsc-")))
            self._outputs = OutputFiles(folder)
            self._simulated = stack.enter_context(contextlib.ExitStack())
            simulation = self._simulated.enter_context(
                simulating(scene, settings, self._told, folder, engine)
            )
            self._stepper = Stepper(scene, settings, simulation, self._trace)
            self._observe()
            self._open = stack.pop_all()

    @property
    def over(self) -> bool:
        """Whether the horizon is reached."""
        return self._stepper.over

    def _observe(self) -> None:
        self.truth = self._stepper.measure()
        self._reported = self._stepper.observe(self.truth)
        self.observation = self._reported.copy()
        if self._imputer is not None:
            self.observation = self._imputer.fill(self._reported.copy())
            self._told.believed = self.observation.values
            if not self.over:
                self._trace.estimate[self._stepper.step] = self.observation.values
        self._asked = time.perf_counter()

    def step(self, phases: IntArray) -> None:
        """Run one decision step with legal ``phases`` (N,), and observe.

        Raises ``RuntimeError`` where the run is over.
        """
        if self.over:
            raise RuntimeError("the run is over")
        self._trace.decision_seconds[self._stepper.step] = time.perf_counter() - self._asked
        self._told.phases = phases
        self._stepper.run(self._rules.decide(self._reported))
        self._observe()

    def result(self) -> Result:
        """What the whole run came to, where it is ``over``; the simulation ends with it."""
        self._simulated.close()
        self._trace.wall_seconds = time.perf_counter() - self._began
        measured = read_outputs(self._scene, self._outputs)
        return summarise(self._scene, self._trace, measured, self._horizon, fallbacks=0)

    def close(self) -> None:
        """Stop the simulation, wherever it is, and leave no files."""
        self._open.close()
