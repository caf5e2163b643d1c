"""Collecting: behaviour policies in closed loop, an episode log for each run."""

import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from pydantic import ValidationError

from tsc_missing.errors import UserError
from tsc_missing.evaluation.scenario import Scenario, find_scenario
from tsc_missing.files import sha256, written_into
from tsc_missing.network.folder import RECORD
from tsc_missing.network.model import BoolArray, Network
from tsc_missing.offline.dataset import (
    EPISODES,
    MANIFEST,
    Dataset,
    DatasetManifest,
    EpisodeEntry,
    Source,
    Statistics,
    add_network,
    merge,
    read_dataset,
    start_dataset,
    write_json,
)
from tsc_missing.offline.episode import play
from tsc_missing.offline.log import EpisodeLog, read_log, write_log
from tsc_missing.offline.plan import POLICY, CollectSettings, EpisodeSpec, draw_spec
from tsc_missing.offline.policies import Unaware, make_policy
from tsc_missing.offline.seen import seen_by_policies, unaware_set
from tsc_missing.own_code import is_own, own_digest
from tsc_missing.processes import worker_processes
from tsc_missing.sensing.observation import QUEUE, VEHICLES
from tsc_missing.sensing.patterns import draw_mask
from tsc_missing.versions import git_revision, versions
from tsc_missing.weights.inputs import of_scenarios

RUNS_PER_PROCESS = 32  # processes end after about so many, with the memory that SUMO has lost

Watch = Callable[[int, int], None]  # (episodes that are there, episodes wanted)


def collect(
    settings: CollectSettings, out: Path, workers: int = 1, watch: Watch | None = None
) -> Dataset:
    """Collect what is not there yet; ends with a whole dataset.

    ``workers`` processes run a simulation each. Stopped at any moment, the same call goes on.
    """
    with written_into(out, "out", "; what is there stays, and the same command goes on"):
        return _collect(settings, out, workers, watch)


def _collect(settings: CollectSettings, out: Path, workers: int, watch: Watch | None) -> Dataset:
    settings.check()
    code = {name: own_digest(name, POLICY) for name in settings.policies if is_own(name)}
    settings = settings.model_copy(update={"code": code})
    scenarios = {net: find_scenario(net, settings.demand) for net in settings.nets}
    _check_scenarios(settings, scenarios)
    sources = {net: scenario.checksums() for net, scenario in scenarios.items()}
    start_dataset(out, settings, of_scenarios(sources))
    scaled = {net: scenario.demand_kind == "profile" for net, scenario in scenarios.items()}
    specs = [
        draw_spec(settings, number, scaled[settings.nets[number % len(settings.nets)]])
        for number in range(settings.episodes)
    ]
    wanted = [spec for spec in specs if not _is_there(out, spec)]
    done = len(specs) - len(wanted)
    for _ in _run_all(wanted, out, workers):
        done += 1
        if watch is not None:
            watch(done, len(specs))
    if wanted or not _is_summed_up(out, settings):
        write_json(out / MANIFEST, _manifest(settings, out, specs, scenarios))
    return read_dataset(out)


def _check_scenarios(settings: CollectSettings, scenarios: dict[str, Scenario]) -> None:
    """What the first episode of each network would stop at, before anything starts."""
    for number, (net, scenario) in enumerate(scenarios.items()):
        volumes = {settings.volume_min, settings.volume_max}
        if scenario.demand_kind != "profile" and settings.demand != "auto" and volumes != {1.0}:
            words = f"the demand of {net} has only volume 1: so must --volume-max, or --demand auto"
            raise UserError("volume-min", settings.volume_min, words)
        spec = draw_spec(settings, number)
        draw_mask(settings.missing, scenario.folder.network, 1, spec.mask_seed)
    for name in settings.policies:
        make_policy([name], None, 0.0)  # one without weights says so now


def run_episode(spec: EpisodeSpec, out: Path, scratch: Path) -> None:
    """Run an episode and write its log into the dataset at ``out``."""
    scenario = find_scenario(spec.net, spec.demand)
    unaware = unaware_set(spec.unaware, spec.seed, scenario.folder.network.n)
    policy = make_policy(spec.policies, spec.switch_at, spec.epsilon, spec.min_space)
    log = play(
        scenario,
        spec.run_settings(),
        Unaware(policy, unaware, spec.seed, spec.neglect),
        spec.missing,
        spec.mask_seed,
        scratch,
        seen_by_policies(spec, scenario.folder.network),
    )
    write_log(out / EPISODES / spec.file, log, spec.model_dump(mode="json"))


def _run_all(specs: list[EpisodeSpec], out: Path, workers: int) -> Iterator[EpisodeSpec]:
    """Run episodes in processes of their own; gives each as it ends, in any order."""
    if not specs:
        return
    size = workers * RUNS_PER_PROCESS
    with tempfile.TemporaryDirectory(prefix="tsc-collect-") as scratch:
        for first in range(0, len(specs), size):
            some = specs[first : first + size]
            with worker_processes(min(workers, len(some))) as pool:
                futures = {
                    pool.submit(run_episode, spec, out, Path(scratch)): spec for spec in some
                }
                for future in as_completed(futures):
                    future.result()
                    yield futures[future]


def _is_there(out: Path, spec: EpisodeSpec) -> bool:
    path = out / EPISODES / spec.file
    if not path.is_file():
        return False
    try:
        pq.read_schema(path)
    except (OSError, ValueError):
        return False
    return True


def _is_summed_up(out: Path, settings: CollectSettings) -> bool:
    """Whether the manifest is of as many episodes: one of fewer is from before there were more."""
    try:
        text = (out / MANIFEST).read_text(encoding="utf-8")
        return len(DatasetManifest.model_validate_json(text).episodes) == settings.episodes
    except (OSError, ValueError):
        return False


def _manifest(
    settings: CollectSettings, out: Path, specs: list[EpisodeSpec], scenarios: dict[str, Scenario]
) -> DatasetManifest:
    networks = {net: scenario.folder.network for net, scenario in scenarios.items()}
    episodes = tuple(_entry(out, spec, networks[spec.net]) for spec in specs)
    return DatasetManifest(
        complete=settings.missing.pattern == "none",
        settings=settings,
        sources={net: _source(out, scenario) for net, scenario in scenarios.items()},
        statistics=merge([episode.statistics for episode in episodes]),
        versions=versions(),
        git=git_revision(),
        episodes=episodes,
    )


def _source(out: Path, scenario: Scenario) -> Source:
    return Source(
        scenario=scenario.name,
        demand=scenario.demand_kind,
        network=add_network(out, scenario.folder.path / RECORD),
        checksums=scenario.checksums(),
    )


def _entry(out: Path, spec: EpisodeSpec, network: Network) -> EpisodeEntry:
    path = out / EPISODES / spec.file
    log, about = read_log(path)
    if not _is_of(spec, about):
        raise UserError("out", path, "it is an episode of another collection")
    recorded = log.recorded & network.slot_mask
    statistics = _statistics(log, recorded)
    rows = recorded.any(axis=2).sum()
    queue = statistics.mean_queue * statistics.cells / max(int(rows), 1)
    steps, n = log.phase.shape
    return EpisodeEntry(
        spec=spec,
        checksum=sha256(path),
        steps=steps,
        intersections=n,
        mean_queue=queue,
        statistics=statistics,
    )


def _is_of(spec: EpisodeSpec, about: dict[str, Any]) -> bool:
    """Whether a log is of an episode; one of an earlier version does not tell what came later."""
    try:
        return EpisodeSpec.model_validate(about) == spec
    except ValidationError:
        return False


def _statistics(log: EpisodeLog, recorded: BoolArray) -> Statistics:
    cells = log.values[recorded]  # (cells, F)
    if not len(cells):
        cells = np.zeros((1, cells.shape[1]), dtype=cells.dtype)
    mean, most = cells.mean(axis=0, dtype=float), cells.max(axis=0)
    return Statistics(
        cells=int(recorded.sum()),
        mean_vehicles=float(mean[VEHICLES]),
        max_vehicles=float(most[VEHICLES]),
        mean_queue=float(mean[QUEUE]),
        max_queue=float(most[QUEUE]),
    )
