"""Several datasets as one to learn from: the shipped weights' and one's own, for example."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

from tsc_missing.errors import UserError
from tsc_missing.network.model import Network
from tsc_missing.offline.dataset import Dataset, EpisodeEntry, read_dataset
from tsc_missing.offline.log import FIELD, EpisodeLog


class Episodes(Protocol):
    """What is learned from: a dataset, or several as one. The members are those of ``Dataset``."""

    @property
    def path(self) -> Path: ...  # noqa: D102
    @property
    def checksum(self) -> str: ...  # noqa: D102
    @property
    def episodes(self) -> Sequence[EpisodeEntry]: ...  # noqa: D102
    @property
    def networks(self) -> Mapping[str, Network]: ...  # noqa: D102
    def net(self, number: int) -> str: ...  # noqa: D102
    def load(self, number: int) -> EpisodeLog: ...  # noqa: D102
    def check_episodes(self) -> None: ...  # noqa: D102
    def about(self) -> dict[str, Any]: ...  # noqa: D102


@dataclass(frozen=True)
class JoinedDatasets:
    """The episodes of all ``parts``, one dataset after the other.

    Networks of one name in two datasets stay two.
    """

    parts: tuple[Dataset, ...]

    @property
    def path(self) -> Path:
        """The first dataset's, for messages."""
        return self.parts[0].path

    @property
    def checksum(self) -> str:
        """SHA-256 of theirs, in their order."""
        return hashlib.sha256("".join(part.checksum for part in self.parts).encode()).hexdigest()

    @cached_property
    def episodes(self) -> tuple[EpisodeEntry, ...]:
        """What the manifests say of the episodes."""
        return tuple(entry for part in self.parts for entry in part.episodes)

    @cached_property
    def networks(self) -> dict[str, Network]:
        """The networks by the names that ``net`` gives."""
        return {
            _name(place, net): network
            for place, part in enumerate(self.parts)
            for net, network in part.networks.items()
        }

    def net(self, number: int) -> str:
        """The name in ``networks`` of an episode's network."""
        place, number = self._place(number)
        return _name(place, self.parts[place].net(number))

    def load(self, number: int) -> EpisodeLog:
        """The log of an episode; ``UserError`` if its file is not the one that was collected."""
        place, number = self._place(number)
        return self.parts[place].load(number)

    def check_episodes(self) -> None:
        """Raise ``UserError`` if the file of an episode is not the one that was collected."""
        for part in self.parts:
            part.check_episodes()

    def about(self) -> dict[str, Any]:
        """What the manifest of weights that were learned from them says of them (JSON values)."""
        return {
            "checksum": self.checksum,
            "complete": all(part.manifest.complete for part in self.parts),
            "joined": [part.about() for part in self.parts],
        }

    def _place(self, number: int) -> tuple[int, int]:
        """Which dataset an episode is of, and its number there."""
        for place, part in enumerate(self.parts):
            if number < len(part.episodes):
                return place, number
            number -= len(part.episodes)
        raise IndexError(number)


def read_datasets(paths: Path | Sequence[Path]) -> Episodes:
    """The dataset in a folder, or those in several as one; ``UserError`` as ``read_dataset``."""
    if isinstance(paths, Path):
        return read_dataset(paths)
    if len({path.resolve() for path in paths}) < len(paths):
        raise UserError(FIELD, ", ".join(map(str, paths)), "a dataset is named twice")
    return JoinedDatasets(tuple(read_dataset(path) for path in paths))


def _name(place: int, net: str) -> str:
    return f"{place}:{net}"
