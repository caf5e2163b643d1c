"""The closed loop: advance, read, mask, decide, apply, for every decision step of a run."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsc_missing.config import RunSettings
from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.demand.driving import driving_of
from tsc_missing.demand.trips import Demand, turning_flows, write_routes
from tsc_missing.network.model import BoolArray, FloatArray, IntArray, Network
from tsc_missing.seeding import stream
from tsc_missing.sensing.observation import N_FEATURES, Measurement, apply_mask
from tsc_missing.simulation.detectors import Detectors, write_area_detectors
from tsc_missing.simulation.engine import EngineName, Inputs, Simulation
from tsc_missing.simulation.outputs import OutputFiles
from tsc_missing.simulation.programs import NativeProgram
from tsc_missing.simulation.recall import MaximumRecall
from tsc_missing.simulation.signals import Signals

UNCOUNTED = 100.0  # [vehicles/h] of a lane that nobody counted


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

    def keep_plan(self, step: int, plan: FloatArray) -> None:
        """Take in what the controller expects (N, H, 12, F) of the steps after ``step``."""
        if self.planned is None:
            self.planned = np.full((len(self.time), *plan.shape), np.nan, dtype=np.float32)
        self.planned[step] = plan


@dataclass(frozen=True)
class Progress:
    """The state of a run for who watches it."""

    time: float  # [s]
    running: int  # vehicles in the network
    waiting: int  # vehicles that wait to enter
    att: float  # [s] so far: vehicle-seconds since scheduled departure over vehicles scheduled


Watch = Callable[[Progress], None]


@dataclass(frozen=True)
class Moment:
    """The simulation at the start of a decision step, for who tries out what could come of it."""

    step: int
    truth: Measurement
    simulation: Simulation
    signals: Signals
    detectors: Detectors


Explore = Callable[[Moment], None]
"""Called before each decision; must leave the simulation and the signals as they were."""


def control_context(scene: Scene, settings: RunSettings) -> ControlContext:
    """What the controller knows before the first step."""
    signals, demand = settings.signals, scene.demand
    driving = driving_of(demand, settings.vehicle)
    return ControlContext(
        network=scene.network,
        turning_flows=_told_flows(demand, scene.network, settings),
        sensors=np.any(scene.mask, axis=0) if scene.sensors is None else scene.sensors,
        decision_interval=signals.decision_interval,
        lost_time=max(map(signals.yellow_at, scene.network.intersections)) + signals.all_red,
        min_steps=np.array([signals.min_steps_at(node) for node in scene.network.intersections]),
        seed=int(stream(settings.seed, "controller").integers(2**31)),
        spacing=settings.vehicle.spacing,
        tau=driving.tau,
        max_speed=driving.max_speed,
        detector_length=settings.sensor.reach,
        counted=settings.turning_counts != "none",
    )


def _told_flows(demand: Demand, network: Network, settings: RunSettings) -> FloatArray:
    """(N, 12) [vehicles/h]: the turning flows that controllers are told.

    Those that ``demand`` sends, as a count that is off by the ``count_error`` has them; without
    turning counts ``UNCOUNTED`` for each lane, a lane that slots share in equal parts.
    """
    if settings.turning_counts == "none":
        return UNCOUNTED * network.lane_parts
    flows = turning_flows(demand.trips, network, min(settings.horizon, demand.span))
    if not settings.count_error:
        return flows
    noise = stream(settings.seed, "counts").standard_normal(flows.shape)
    return np.asarray(flows * np.exp(settings.count_error * noise))


def run_closed_loop(
    scene: Scene,
    settings: RunSettings,
    controller: Controller | NativeProgram,
    folder: Path,
    engine: EngineName = "libsumo",
    watch: Watch | None = None,
    explore: Explore | None = None,
) -> Trace:
    """Run the whole horizon; SUMO's inputs and outputs go to ``folder``, which must exist.

    A ``NativeProgram`` is a signal program that SUMO runs itself; the loop then only looks on, and
    tells the one that loses sensors which are silent.
    """
    began = time.perf_counter()
    inputs = _write_inputs(scene, settings, controller, folder)
    trace = Trace.empty(scene.mask)
    if isinstance(controller, Controller):
        controller.reset(control_context(scene, settings))
    with Simulation(inputs, OutputFiles(folder).options(), engine, settings.seed) as simulation:
        detectors = Detectors(scene.network, settings.sensor, simulation.api)
        meter = _Meter(scene.demand, watch, simulation)
        if isinstance(controller, Controller):
            _control(scene, settings, controller, simulation, detectors, trace, meter, explore)
        else:
            _look_on(scene, settings, controller, simulation, detectors, trace, meter)
    trace.wall_seconds = time.perf_counter() - began
    return trace


def _write_inputs(
    scene: Scene, settings: RunSettings, controller: Controller | NativeProgram, folder: Path
) -> Inputs:
    routes, lanes = folder / "demand.rou.xml", folder / "lanes.add.xml"
    write_routes(scene.demand, settings.vehicle, routes, scene.begin)
    OutputFiles(folder).write_lane_request(lanes)
    additional = [*([scene.additional] if scene.additional else []), lanes]
    if settings.sensor.kind == "area":
        additional.append(folder / "detectors.add.xml")
        write_area_detectors(scene.network, settings.sensor.length, additional[-1])
    if isinstance(controller, NativeProgram):
        programs = folder / "signals.add.xml"
        if controller.write(settings.signals, programs):
            additional.append(programs)
    return Inputs(scene.net_file, routes, tuple(additional), scene.begin)


def _control(
    scene: Scene,
    settings: RunSettings,
    controller: Controller,
    simulation: Simulation,
    detectors: Detectors,
    trace: Trace,
    meter: "_Meter",
    explore: Explore | None,
) -> None:
    send = simulation.api.trafficlight.setRedYellowGreenState
    timing = settings.signals
    signals = Signals(scene.network, timing, send)
    for step in range(len(scene.mask)):
        now = step * timing.decision_interval
        end = min(now + timing.decision_interval, settings.horizon)
        truth = detectors.read()
        if explore is not None:
            explore(Moment(step, truth, simulation, signals, detectors))
        observation = apply_mask(
            truth, scene.mask[step], step, now, signals.phase, signals.red_steps
        )
        asked = time.perf_counter()
        phases = controller.decide(observation)
        trace.decision_seconds[step] = time.perf_counter() - asked
        run_step(simulation, signals, phases, now, end)
        trace.time[step], trace.truth[step], trace.phase[step] = now, truth.values, signals.phase
        estimates = controller.estimates()
        if estimates is not None:
            trace.estimate[step] = estimates
        plans = controller.plans()
        if plans is not None:
            trace.keep_plan(step, plans)
        meter.update(end)
    trace.held = signals.held


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


def _look_on(
    scene: Scene,
    settings: RunSettings,
    program: NativeProgram,
    simulation: Simulation,
    detectors: Detectors,
    trace: Trace,
    meter: "_Meter",
) -> None:
    interval = settings.signals.decision_interval
    program.start(simulation.api)
    recall = None if program.sees_all else MaximumRecall(scene.network, simulation.api)
    for step in range(len(trace.time)):
        now, end = step * interval, min((step + 1) * interval, settings.horizon)
        trace.time[step], trace.truth[step] = now, detectors.read().values
        if recall is not None:
            recall.update(scene.mask[step])
        simulation.advance(end)
        trace.phase[step] = program.phases(simulation.api)
        meter.update(end)


class _Meter:
    """Running totals for who watches; asks the simulator for nothing when nobody does."""

    def __init__(self, demand: Demand, watch: Watch | None, simulation: Simulation) -> None:
        self._scheduled = np.array([trip.depart for trip in demand.trips])
        self._watch = watch
        self._simulation = simulation
        self._last = 0.0
        self._seconds = 0.0

    def update(self, now: float) -> None:
        if self._watch is None:
            return
        running = int(self._simulation.api.vehicle.getIDCount())
        waiting = len(self._simulation.api.simulation.getPendingVehicles())
        self._seconds += (now - self._last) * (running + waiting)
        self._last = now
        scheduled = int(np.searchsorted(self._scheduled, now))
        att = self._seconds / scheduled if scheduled else 0.0
        self._watch(Progress(now, running, waiting, att))
