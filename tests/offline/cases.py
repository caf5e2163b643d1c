"""Made-up datasets of grids, without a simulator."""

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tsc_missing.config import MissingSettings
from tsc_missing.files import sha256
from tsc_missing.network.model import Network
from tsc_missing.offline.dataset import (
    EPISODES,
    MANIFEST,
    NETWORKS,
    Dataset,
    DatasetManifest,
    EpisodeEntry,
    Source,
    Statistics,
    read_dataset,
    start_dataset,
    write_json,
)
from tsc_missing.offline.log import EpisodeLog, red_steps_of, write_log
from tsc_missing.offline.plan import CollectSettings, draw_spec
from tsc_missing.sensing.patterns import draw_mask

NOTHING = Statistics(cells=1, mean_vehicles=0, max_vehicles=0, mean_queue=0, max_queue=0)


Change = Callable[[EpisodeLog], EpisodeLog]


def made_up_log(
    network: Network,
    steps: int,
    seed: int,
    holes: float = 0.0,
    missing: MissingSettings | None = None,
) -> EpisodeLog:
    """Random counts; where there is a hole, zeros.

    Holes are single slots with probability ``holes``, or of the pattern ``missing``.
    """
    rng = np.random.default_rng(seed)
    shape = (steps, network.n, 12)
    phase = rng.integers(0, network.phase_mask.sum(axis=1), size=shape[:2])
    mask = (rng.random(shape) >= holes) | ~network.slot_mask if holes else None
    if missing is not None:
        mask = draw_mask(missing, network, steps, 0 if missing.pattern == "kriging" else seed)
    values = rng.integers(0, 40, (*shape, 2)) * network.slot_mask[..., None]
    if mask is not None:
        values = np.where(mask[..., None], values, 0)
    return EpisodeLog(values.astype(np.float32), phase, red_steps_of(network, phase), mask)


def made_up_dataset(
    path,
    networks: dict[str, Network],
    episodes: int = 5,
    steps: int = 30,
    holes: float = 0.0,
    missing: MissingSettings | None = None,
    unaware: float = 0.6,
    change: Change = lambda log: log,
    make_log: Callable[..., EpisodeLog] = made_up_log,
) -> Dataset:
    """Episodes of the networks in turn; each one step longer than the one before."""
    settings = CollectSettings(
        nets=tuple(networks),
        episodes=episodes,
        missing=missing or MissingSettings(),
        unaware=unaware,
    )
    start_dataset(path, settings, {})
    sources, entries = {}, []
    for name, network in networks.items():
        file = path / NETWORKS / f"{name}.json"
        file.write_text(json.dumps(network.record.model_dump(mode="json")))
        sources[name] = Source(
            scenario=name, demand="profile", network=file.name, checksums={"it": sha256(file)}
        )
    for number in range(episodes):
        spec = draw_spec(settings, number)
        network = networks[spec.net]
        file = path / EPISODES / spec.file
        pattern = {} if missing is None else {"missing": missing}
        log = change(make_log(network, steps + number, number, holes, **pattern))
        write_log(file, log, {})
        entries.append(
            EpisodeEntry(
                spec=spec,
                checksum=sha256(file),
                steps=steps + number,
                intersections=network.n,
                mean_queue=0.0,
                statistics=NOTHING,
            )
        )
    manifest = DatasetManifest(
        complete=not holes and missing is None,
        settings=settings,
        sources=sources,
        statistics=NOTHING,
        versions={},
        git=None,
        episodes=tuple(entries),
    )
    write_json(path / MANIFEST, manifest)
    return read_dataset(path)


def poison(log: EpisodeLog, value: float) -> EpisodeLog:
    """The same log with a value in the place of what it does not have."""
    values = np.where(log.recorded[..., None], log.values, np.float32(value))
    return replace(log, values=values)
