"""One run, from settings to a run folder and a result."""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tsc_missing.config import RunSettings, SignalSettings
from tsc_missing.controllers.base import Controller
from tsc_missing.controllers.catalogue import NATIVE
from tsc_missing.controllers.fallback import Safe
from tsc_missing.controllers.registry import controller_of
from tsc_missing.controllers.resolved import code_of, resolved, weights_of
from tsc_missing.errors import UserError
from tsc_missing.evaluation.closed_loop import Watch, run_closed_loop
from tsc_missing.evaluation.metrics import Measured, Result, read_outputs, summarise
from tsc_missing.evaluation.scenario import Scenario, find_scenario
from tsc_missing.evaluation.steps import Scene, Trace
from tsc_missing.files import sha256, whole_folder
from tsc_missing.network.model import Network
from tsc_missing.own_code import own_digest
from tsc_missing.sensing.masks_of_runs import mask_file, mask_of, sensors_of
from tsc_missing.sensing.outage_list import is_list
from tsc_missing.simulation.engine import EngineName
from tsc_missing.simulation.native import AS_BUILT
from tsc_missing.simulation.outputs import OutputFiles
from tsc_missing.simulation.programs import NativeProgram
from tsc_missing.versions import git_revision, versions
from tsc_missing.weights.find import find_weights


@dataclass(frozen=True)
class Options:
    """What does not change a run's result: where it goes and what is watched."""

    out: Path | None = None  # the run folder; None keeps nothing
    decisions: bool = True  # write decisions.parquet
    engine: EngineName = "libsumo"
    durable: bool = False  # the run folder is on the disk before it gets its name


@dataclass(frozen=True)
class Prepared:
    """A run that has been checked and can start."""

    settings: RunSettings
    options: Options
    scenario: Scenario
    scene: Scene
    controller: Controller | NativeProgram
    resolved: dict[str, object]  # what the settings that go by the controller are
    checksums: dict[str, str]  # of what it reads, as it was before the run


def prepare(settings: RunSettings, options: Options) -> Prepared:
    """Check everything a user can get wrong before anything starts."""
    scenario = find_scenario(settings.net, settings.demand)
    check_timing(settings.signals, scenario.folder.network)
    controller = _controller(settings, scenario)
    scene = scene_of(settings, scenario, _sees_all(controller))
    found = checksums(settings, scenario)
    return Prepared(settings, options, scenario, scene, controller, resolved(settings), found)


def scene_of(settings: RunSettings, scenario: Scenario, sees_all: bool = False) -> Scene:
    """The demand and the mask of a run, in which nothing is missing for who ``sees_all``."""
    network = scenario.folder.network
    mask = mask_of(settings, network)
    sensors = sensors_of(settings, network, mask)
    if sees_all:
        mask, sensors = np.ones_like(mask), np.ones_like(sensors)
    return replace(scenario.scene(settings, mask), sensors=sensors)


def _sees_all(controller: Controller | NativeProgram) -> bool:
    """Whether nothing is ever missing for it: a program of SUMO's that reads its own detectors."""
    return isinstance(controller, NativeProgram) and controller.sees_all


def check_timing(signals: SignalSettings, network: Network) -> None:
    """Raise ``UserError`` where yellow and all-red do not fit into the decision interval."""
    interval, all_red = signals.decision_interval, signals.all_red
    for node in network.intersections:
        yellow = signals.yellow_at(node)
        if yellow + all_red < interval:
            continue
        at = f"at {node.id}, where the yellow takes {yellow} s"
        if all_red:
            words = f"{at}, both must be shorter than the decision interval, {interval} s"
            raise UserError("all-red", all_red, words)
        raise UserError("decision-interval", interval, f"{at}, it must be longer than that")


def _controller(settings: RunSettings, scenario: Scenario) -> Controller | NativeProgram:
    if settings.controller in NATIVE:
        check_as_built(settings.controller, scenario)
        return NativeProgram(settings.controller, scenario.folder.network)
    controller = controller_of(settings)
    signals = settings.signals
    return Safe(controller, float(signals.decision_interval), max_red=signals.max_red)


def check_as_built(controller: str, scenario: Scenario) -> None:
    """Raise ``UserError`` for the program of a network that came without one.

    The one in its net is netconvert's guess and has other phases.
    """
    kind = scenario.folder.manifest.kind
    if controller == AS_BUILT and kind not in ("sumo", "osm"):
        words = f"{scenario.name} ({kind}) came without signal programs; fixed-time has a plan"
        raise UserError("controller", controller, words)


def execute(prepared: Prepared, watch: Watch | None = None) -> Result:
    """Run it; the run folder, where one is wanted, is whole or not there."""
    if prepared.options.out is None:
        return _execute(prepared, None, watch)
    with whole_folder(prepared.options.out, "out", prepared.options.durable) as folder:
        return _execute(prepared, folder, watch)


def _execute(prepared: Prepared, folder: Path | None, watch: Watch | None) -> Result:
    settings, scene = prepared.settings, prepared.scene
    with tempfile.TemporaryDirectory(prefix="tsc-") as scratch:
        trace = run_closed_loop(
            scene, settings, prepared.controller, Path(scratch), prepared.options.engine, watch
        )
        fallbacks = (
            prepared.controller.fallback_steps if isinstance(prepared.controller, Safe) else 0
        )
        measured = read_outputs(scene, OutputFiles(Path(scratch)))
    result = summarise(scene, trace, measured, settings.horizon, fallbacks)
    if folder is not None:
        _write(folder, prepared, trace, measured, result)
    return result


def _write(
    folder: Path, prepared: Prepared, trace: Trace, measured: Measured, result: Result
) -> None:
    from tsc_missing.evaluation.movements import measure_movements
    from tsc_missing.evaluation.run_folder import (
        write_decisions,
        write_mask,
        write_movements,
        write_run,
        write_trips,
    )

    write_run(folder, describe(prepared, result))
    scene, horizon = prepared.scene, prepared.settings.horizon
    native = isinstance(prepared.controller, NativeProgram)
    write_trips(folder, scene, measured.trips, horizon)
    write_movements(folder, scene, measure_movements(scene, trace, measured, horizon, native))
    if not _sees_all(prepared.controller):
        write_mask(folder, scene)
    if prepared.options.decisions:
        write_decisions(folder, scene, trace)


def checksums(settings: RunSettings, scenario: Scenario) -> dict[str, str]:
    """The SHA-256 of every file that the run reads: network, demand, weights, own code, mask.

    Of own code it is of the file with the class, not of what that imports.
    """
    used = {f"weights: {name}": sha256(find_weights(name)) for name in weights_of(settings)}
    code = {f"code: {name}": own_digest(name, field) for field, name in code_of(settings)}
    path = mask_file(settings)
    mask = {f"mask: {path.name}": sha256(path)} if path is not None else {}
    return {**scenario.checksums(), **used, **code, **mask}


def inputs_of(settings: RunSettings) -> tuple[object, ...]:
    """What ``checksums`` depend on: runs for which this is equal read the same files."""
    mask = settings.missing.file
    return settings.net, settings.demand, weights_of(settings), code_of(settings), mask


def _source_of_mask(settings: RunSettings) -> str:
    path = mask_file(settings)
    return "drawn" if path is None else "listed" if is_list(path) else "replayed"


def describe(prepared: Prepared, result: Result) -> dict[str, object]:
    """The content of ``run.json``: settings, what they resolved to, versions, result."""
    scenario = prepared.scenario
    controller = prepared.controller
    return {
        "settings": prepared.settings.model_dump(mode="json"),
        "resolved": prepared.resolved,
        "scenario": scenario.name,
        "demand": scenario.demand_kind,
        "begin": scenario.folder.begin,
        "engine": prepared.options.engine,
        "mask": _source_of_mask(prepared.settings),
        "checksums": prepared.checksums,
        "versions": versions(),
        "git": git_revision(),
        "fallback_error": controller.last_error if isinstance(controller, Safe) else "",
        "result": result.model_dump(mode="json"),
    }
