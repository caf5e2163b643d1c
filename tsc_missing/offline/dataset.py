"""Datasets: a folder of episode logs, the networks they are of, and a manifest.

``manifest.json`` is written last, so a folder that has one is whole; ``plan.json`` is there from
the start. A dataset is complete in itself: it can be read where the networks are not installed.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, TypeAdapter

from tsc_missing.errors import UserError
from tsc_missing.files import is_barely_begun, parse, read_json, replace_file, sha256
from tsc_missing.network.folder import RECORD
from tsc_missing.network.model import Network
from tsc_missing.network.records import NetworkRecord
from tsc_missing.offline.log import FIELD, EpisodeLog, read_log
from tsc_missing.offline.plan import CollectSettings, EpisodeSpec
from tsc_missing.weights.inputs import check_inputs, write_inputs

MANIFEST, PLAN, EPISODES, NETWORKS = "manifest.json", "plan.json", "episodes", "networks"


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Statistics(_Part):
    """Of the recorded cells of slots that are there [vehicles]."""

    cells: int
    mean_vehicles: float
    max_vehicles: float
    mean_queue: float
    max_queue: float


class EpisodeEntry(_Part):
    """One episode's file."""

    spec: EpisodeSpec
    checksum: str  # SHA-256 of the file
    steps: int
    intersections: int
    mean_queue: float  # vehicles queueing at an intersection, where recorded
    statistics: Statistics


class Source(_Part):
    """The network and the demand behind a name in ``nets``."""

    scenario: str
    demand: Literal["profile", "recorded", "generated"]
    network: str  # the file in ``networks``
    checksums: dict[str, str]  # SHA-256 of the net, its record and the demand file


class DatasetManifest(_Part):
    """What ``manifest.json`` holds."""

    format: Literal[1] = 1
    complete: bool  # or the logs have holes
    settings: CollectSettings
    sources: dict[str, Source]  # by the name in ``settings.nets``
    statistics: Statistics
    versions: dict[str, str]
    git: str | None
    episodes: tuple[EpisodeEntry, ...]


_MANIFEST = TypeAdapter(DatasetManifest)
_SETTINGS = TypeAdapter(CollectSettings)
_RECORD = TypeAdapter(NetworkRecord)


@dataclass(frozen=True)
class Dataset:
    """A dataset on disk; episodes are read when asked for."""

    path: Path
    manifest: DatasetManifest

    @property
    def checksum(self) -> str:
        """SHA-256 of the manifest, which has those of all else."""
        return sha256(self.path / MANIFEST)

    @property
    def episodes(self) -> tuple[EpisodeEntry, ...]:
        """What the manifest says of the episodes."""
        return self.manifest.episodes

    def net(self, number: int) -> str:
        """The name in ``networks`` of an episode's network."""
        return self.episodes[number].spec.net

    def about(self) -> dict[str, Any]:
        """What the manifest of weights that were learned from it says of it (JSON values)."""
        manifest = self.manifest
        return {
            "checksum": self.checksum,
            "complete": manifest.complete,
            "episodes": len(self.episodes),
            "settings": manifest.settings.model_dump(mode="json"),
            "sources": {net: source.checksums for net, source in manifest.sources.items()},
        }

    @cached_property
    def networks(self) -> dict[str, Network]:
        """The networks by the names in ``settings.nets``."""
        return {net: self._network(source) for net, source in self.manifest.sources.items()}

    def _network(self, source: Source) -> Network:
        path = self.path / NETWORKS / source.network
        value = read_json(path, FIELD)
        if sha256(path) not in source.checksums.values():
            raise UserError(FIELD, path, "it is another network than the episodes are of")
        return Network(source.scenario, parse(_RECORD, value, FIELD, path))

    def check_episodes(self) -> None:
        """Raise ``UserError`` if the file of an episode is not the one that was collected."""
        for number in range(len(self.episodes)):
            self._file(number)

    def _file(self, number: int) -> Path:
        entry = self.episodes[number]
        path = self.path / EPISODES / entry.spec.file
        if not path.is_file():
            raise UserError(FIELD, path, "the episode is missing")
        if sha256(path) != entry.checksum:
            raise UserError(FIELD, path, "the episode was changed or damaged (other checksum)")
        return path

    def load(self, number: int) -> EpisodeLog:
        """The log of an episode; ``UserError`` if its file is not the one that was collected."""
        entry, path = self.episodes[number], self._file(number)
        log, _ = read_log(path)
        if log.phase.shape != (entry.steps, self.networks[self.net(number)].n):
            raise UserError(FIELD, path, "it is of another network than its dataset says")
        return log


def read_dataset(path: Path) -> Dataset:
    """The dataset in a folder; ``UserError`` if it is none, unfinished or of another format."""
    if not path.is_dir():
        raise UserError(FIELD, path, "there is no such folder")
    if not (path / MANIFEST).is_file():
        if (path / PLAN).is_file():
            raise UserError(FIELD, path, "its collection is not finished; tsc-collect goes on")
        if (path / RECORD).is_file():
            raise UserError(FIELD, path, "it is a network; tsc-collect --net makes a dataset of it")
        raise UserError(FIELD, path, f"it has no {MANIFEST}, so it is no dataset")
    value = read_json(path / MANIFEST, FIELD)
    found = value.get("format") if isinstance(value, dict) else None
    if found != 1:
        raise UserError(FIELD, path, f"it has format {found}, and this program reads 1")
    return Dataset(path, parse(_MANIFEST, value, FIELD, path / MANIFEST))


def start_dataset(path: Path, settings: CollectSettings, inputs: Mapping[str, str]) -> None:
    """Make the folder of a dataset, or check that the one that is there can be gone on with.

    All but the number of episodes must be as it was, and so the ``inputs``, the files of the
    networks and demands by checksum. A collection without an episode is begun anew.
    """
    if path.exists() and not path.is_dir():
        raise UserError("out", path, "it is a file, and must be a folder")
    if path.is_dir() and not (path / PLAN).is_file() and not is_barely_begun(path):
        raise UserError("out", path, f"the folder is not empty and has no {PLAN}")
    numbers = [int(k.stem) for k in (path / EPISODES).glob("[0-9]*.parquet")]
    if (path / PLAN).is_file() and numbers:
        _check_same(path, settings)
        check_inputs(path, inputs, "out")
        if settings.episodes <= max(numbers):
            words = f"there are {max(numbers) + 1} in {path}, and so many at least must be"
            raise UserError("episodes", settings.episodes, words)
    try:
        for folder in (EPISODES, NETWORKS):
            (path / folder).mkdir(parents=True, exist_ok=True)
        for left in (path / EPISODES).glob(".*"):
            left.unlink(missing_ok=True)
        write_json(path / PLAN, settings)
        write_inputs(path, inputs)
    except OSError as error:
        raise UserError("out", path, f"cannot be written ({error.strerror})") from error


def _check_same(path: Path, settings: CollectSettings) -> None:
    before = parse(_SETTINGS, read_json(path / PLAN, "out"), "out", path / PLAN)
    for name in CollectSettings.model_fields:
        was, wanted = getattr(before, name), getattr(settings, name)
        if was != wanted and name != "episodes":
            raise UserError("out", path, f"it was begun with {name} {was}, not {wanted}")


def add_network(path: Path, record: Path) -> str:
    """Copy a network's record into the dataset; returns its name there, from its content."""
    name = f"{sha256(record)[:16]}.json"
    if not (path / NETWORKS / name).exists():
        replace_file(path / NETWORKS / name, record.read_bytes())
    return name


def write_json(path: Path, model: BaseModel) -> None:
    """Write a model, whole or not at all."""
    text = json.dumps(model.model_dump(mode="json"), indent=1) + "\n"
    replace_file(path, text.encode())


def merge(parts: Sequence[Statistics]) -> Statistics:
    """The statistics of all cells together."""
    cells = sum(part.cells for part in parts)

    def mean(name: str) -> float:
        total: float = sum(getattr(part, name) * part.cells for part in parts)
        return total / max(cells, 1)

    return Statistics(
        cells=cells,
        mean_vehicles=mean("mean_vehicles"),
        max_vehicles=max(part.max_vehicles for part in parts),
        mean_queue=mean("mean_queue"),
        max_queue=max(part.max_queue for part in parts),
    )
