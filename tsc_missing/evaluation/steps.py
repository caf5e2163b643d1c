"""The decision steps of a run: what it needs, what happened, and one step after the other."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsc_missing.config import RunSettings
from tsc_missing.controllers.base import Controller
from tsc_missing.demand.trips import Demand
from tsc_missing.network.model import BoolArray, FloatArray, IntArray, Network
from tsc_missing.sensing.observation import (
    N_FEATURES,
    Measurement,
    Observation,
    apply_mask,
)
from tsc_missing.simulation.detectors import Detectors
from tsc_missing.simulation.engine import Simulation
from tsc_missing.simulation.signals import Signals


@dataclass(frozen=True)
class Scene:
    """All that a run needs besides its settings."""

    network: Network
    net_file: Path
    demand: Demand
    mask: BoolArray  # (T, N, 12)
    begin: float = 0.0  # [s] on SUMO's clock; all other times count from it
    additional: Path | None = None  # signal programs beside those of the net
    sensors: BoolArray | None = None  # (N, 12) the inventory; None: those that ever report


@dataclass
class Trace:
    """What happened at each of T decision steps; rows are filled as the run goes."""

    time: FloatArray  # (T,) [s]
    phase: IntArray  # (T, N) that ran in the step; -1 where SUMO's own program is between two
    truth: FloatArray  # (T, N, 12, F)
    estimate: FloatArray  # (T, N, 12, F); NaN where the controller filled nothing
    mask: BoolArray  # (T, N, 12)
    decision_seconds: FloatArray  # (T,)
    planned: FloatArray | None = None  # (T, N, H, 12, F) of the next H steps; NaN without a plan
    held: int = 0
    wall_seconds: float = 0.0

    @classmethod
    def empty(cls, mask: BoolArray) -> "Trace":
        """A trace of T steps with nothing in it."""
        steps, n, slots = mask.shape
        shape = (steps, n, slots, N_FEATURES)
        return cls(
            time=np.full(steps, np.nan),
            phase=np.full((steps, n), -1, dtype=np.int64),
            truth=np.zeros(shape),
            estimate=np.full(shape, np.nan),
            mask=mask,
            decision_seconds=np.full(steps, np.nan),
        )

    def keep_beliefs(self, step: int, controller: Controller) -> None:
        """Take in what the controller believes of ``step``, and expects of the steps after it."""
        estimates, plans = controller.estimates(), controller.plans()
        if estimates is not None:
            self.estimate[step] = estimates
        if plans is None:
            return
        if self.planned is None:
            self.planned = np.full((len(self.time), *plans.shape), np.nan, dtype=np.float32)
        self.planned[step] = plans


class Stepper:
    """The decision steps of a run, one at a time: observe, and run with the phases that are told.

    What happens is kept in ``trace``, but for what the controller believes.
    """

    def __init__(
        self, scene: Scene, settings: RunSettings, simulation: Simulation, trace: Trace
    ) -> None:
        """At the begin of the simulation."""
        send = simulation.api.trafficlight.setRedYellowGreenState
        self.step = 0  # that is observed, or runs
        self.simulation = simulation
        self.signals = Signals(scene.network, settings.signals, send)
        self.detectors = Detectors(scene.network, settings.sensor, simulation.api)
        self._mask = scene.mask
        self._interval = settings.signals.decision_interval
        self._horizon = settings.horizon
        self._trace = trace

    @property
    def over(self) -> bool:
        """Whether all steps have run."""
        return self.step == len(self._mask)

    @property
    def now(self) -> float:
        """[s] since the begin, where no step is running."""
        return min(self.step * self._interval, self._horizon)

    def measure(self) -> Measurement:
        """The truth at the start of the step, or at the end of the run."""
        truth = self.detectors.read()
        if not self.over:
            self._trace.time[self.step], self._trace.truth[self.step] = self.now, truth.values
        return truth

    def observe(self, truth: Measurement) -> Observation:
        """What the sensors report of it; at the end those that did in the last step."""
        mask, signals = self._mask[min(self.step, len(self._mask) - 1)], self.signals
        return apply_mask(truth, mask, self.step, self.now, signals.phase, signals.red_steps)

    def run(self, phases: IntArray) -> None:
        """Simulate the step with the signals on their way to ``phases`` (N,)."""
        end = min((self.step + 1) * self._interval, self._horizon)
        run_step(self.simulation, self.signals, phases, self.now, end)
        self._trace.phase[self.step] = self.signals.phase
        self._trace.held = self.signals.held
        self.step += 1


def run_step(
    simulation: Simulation, signals: Signals, phases: IntArray, now: float, end: float
) -> None:
    """Simulate from ``now`` to ``end`` [s] with the signals on their way to ``phases`` (N,)."""
    signals.command(phases, now)
    for moment in signals.moments:
        if moment < end:
            simulation.advance(moment)
            signals.clear(moment)
            signals.release(moment)
    simulation.advance(end)
