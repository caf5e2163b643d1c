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
from tsc_missing.evaluation.steps import Scene, Stepper, Trace
from tsc_missing.network.model import FloatArray, Network
from tsc_missing.seeding import stream
from tsc_missing.sensing.observation import Measurement
from tsc_missing.simulation.detectors import Detectors, write_area_detectors
from tsc_missing.simulation.engine import EngineName, Inputs, Simulation
from tsc_missing.simulation.outputs import OutputFiles
from tsc_missing.simulation.programs import NativeProgram
from tsc_missing.simulation.recall import MaximumRecall
from tsc_missing.simulation.signals import Signals

UNCOUNTED = 100.0  # [vehicles/h] of a lane that nobody counted


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
    trace = Trace.empty(scene.mask)
    if isinstance(controller, Controller):
        controller.reset(control_context(scene, settings))
    with simulating(scene, settings, controller, folder, engine) as simulation:
        meter = _Meter(scene.demand, watch, simulation)
        if isinstance(controller, Controller):
            stepper = Stepper(scene, settings, simulation, trace)
            _control(stepper, controller, trace, meter, explore)
        else:
            _look_on(scene, settings, controller, simulation, trace, meter)
    trace.wall_seconds = time.perf_counter() - began
    return trace


def simulating(
    scene: Scene,
    settings: RunSettings,
    controller: Controller | NativeProgram,
    folder: Path,
    engine: EngineName = "libsumo",
) -> Simulation:
    """The simulation of a run, not begun yet (a context manager); its inputs are in ``folder``."""
    inputs = _write_inputs(scene, settings, controller, folder)
    return Simulation(inputs, OutputFiles(folder).options(), engine, settings.seed)


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
    stepper: Stepper,
    controller: Controller,
    trace: Trace,
    meter: "_Meter",
    explore: Explore | None,
) -> None:
    while not stepper.over:
        step, truth = stepper.step, stepper.measure()
        if explore is not None:
            explore(Moment(step, truth, stepper.simulation, stepper.signals, stepper.detectors))
        observation = stepper.observe(truth)
        asked = time.perf_counter()
        phases = controller.decide(observation)
        trace.decision_seconds[step] = time.perf_counter() - asked
        stepper.run(phases)
        trace.keep_beliefs(step, controller)
        meter.update(stepper.now)


def _look_on(
    scene: Scene,
    settings: RunSettings,
    program: NativeProgram,
    simulation: Simulation,
    trace: Trace,
    meter: "_Meter",
) -> None:
    interval = settings.signals.decision_interval
    detectors = Detectors(scene.network, settings.sensor, simulation.api)
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
