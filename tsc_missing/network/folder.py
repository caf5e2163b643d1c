"""Network folders: a SUMO net, its ``network.json``, perhaps routes, and a manifest."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, TypeAdapter

from tsc_missing.errors import UserError, nearest
from tsc_missing.files import parse, read_json, sha256
from tsc_missing.network.model import Network
from tsc_missing.network.records import NetworkRecord
from tsc_missing.paths import bundled, user_networks
from tsc_missing.versions import versions

FIELD = "net"
NET = "net.net.xml"
RECORD = "network.json"
ROUTES = "routes.rou.xml"
SIGNALS = "signals.add.xml"
MANIFEST = "manifest.json"

_RECORD = TypeAdapter(NetworkRecord)


class Manifest(BaseModel):
    """What ``manifest.json`` says: what the folder was made of, by what, and its checksums."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal[1] = 1
    name: str
    kind: Literal["grid", "cityflow", "sumo", "osm", "generated"]
    intersections: int
    vehicles: int | None = None  # of the demand that is in the folder, where there is one
    demand: Literal["recorded", "generated"] | None = None  # None: recorded, where there is one
    begin: float | None = None  # [s] on SUMO's clock, 0 if not given
    horizon: float | None = None  # [s] after the begin that the demand was read up to
    recipe: str | None = None  # the command line that makes a generated network
    notes: tuple[str, ...] | None = None  # what was left out or is odd
    sources: dict[str, str] = {}  # SHA-256 of the files it was made from, by file name
    files: dict[str, str] = {}  # SHA-256 of the folder's own files
    versions: dict[str, str] = {}


_MANIFEST = TypeAdapter(Manifest)


@dataclass(frozen=True)
class NetworkFolder:
    """A network folder that was read and found whole."""

    path: Path
    manifest: Manifest
    network: Network

    @property
    def net_file(self) -> Path:
        """The SUMO net."""
        return self.path / NET

    @property
    def begin(self) -> float:
        """The time on SUMO's clock that runs begin at [s]."""
        return self.manifest.begin or 0.0

    @property
    def signals_file(self) -> Path | None:
        """Signal programs beside those of the net, where there are some."""
        path = self.path / SIGNALS
        return path if path.exists() else None

    @property
    def routes_file(self) -> Path | None:
        """The recorded demand as a SUMO route file, where the folder has one."""
        path = self.path / ROUTES
        return path if path.exists() else None


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write the manifest last, with the checksums of the files that are in the folder."""
    names = [name for name in (NET, RECORD, ROUTES, SIGNALS) if (folder / name).exists()]
    whole = manifest.model_copy(update={"files": {n: sha256(folder / n) for n in names}})
    text = json.dumps(whole.model_dump(exclude_none=True), indent=1) + "\n"
    (folder / MANIFEST).write_text(text, encoding="utf-8")


def builder_versions() -> dict[str, str]:
    """The versions that a built network depends on."""
    wanted = ("tsc-missing", "libsumo")
    return {name: version for name, version in versions().items() if name in wanted}


def read_folder(path: Path, given: str) -> NetworkFolder:
    """The network folder at ``path``; ``UserError`` tells what is not there or has changed.

    ``given`` is what a user named it by.
    """
    if not (path / MANIFEST).is_file():
        raise UserError(FIELD, given, f"{path} has no {MANIFEST}, so it is no network folder")
    manifest = parse(_MANIFEST, read_json(path / MANIFEST, FIELD), FIELD, path / MANIFEST)
    _check_files(path, manifest.files, given)
    record = parse(_RECORD, read_json(path / RECORD, FIELD), FIELD, path / RECORD)
    return NetworkFolder(path, manifest, Network(manifest.name, record))


def _check_files(path: Path, files: Mapping[str, str], given: str) -> None:
    for required in (NET, RECORD):
        if required not in files:
            raise UserError(FIELD, given, f"{path / MANIFEST} does not list {required}")
    for file, checksum in files.items():
        if not (path / file).is_file():
            raise UserError(FIELD, given, f"{path / file} is missing")
        if sha256(path / file) != checksum:
            raise UserError(
                FIELD, given, f"{path / file} is not the file that was built (other checksum)"
            )


def bundled_cities() -> tuple[str, ...]:
    """The names of the bundled networks."""
    root = bundled("networks")
    return tuple(sorted(p.name for p in root.iterdir() if (p / MANIFEST).is_file()))


def bundled_profiles() -> dict[str, Path]:
    """The bundled demand profiles by dataset, as ``jinan_1``."""
    return {path.stem: path for path in sorted((bundled("scenarios") / "demand").glob("*.json"))}


def imported_networks() -> dict[str, Path]:
    """The networks in the user's data folder by name."""
    root = user_networks()
    if not root.is_dir():
        return {}
    return {p.name: p for p in sorted(root.iterdir()) if (p / MANIFEST).is_file()}


def canonical(name: str) -> str:
    """A city's name means its first dataset: ``jinan`` is ``jinan_1``."""
    return f"{name}_1" if name in bundled_cities() else name


def network_name(net: str) -> str:
    """The name of a network given by its name or its folder."""
    return Path(canonical(net)).resolve().name


def city_of(dataset: str) -> str:
    """The bundled network that a bundled dataset is on."""
    return next(city for city in bundled_cities() if dataset.startswith(f"{city}_"))


def check_dataset(target: Path, name: str, record: NetworkRecord, field: str) -> None:
    """Raise ``UserError`` where another network would be found under a bundled dataset's name."""
    if target.parent != user_networks() or name not in bundled_profiles():
        return
    city = city_of(name)
    ours = read_folder(bundled("networks") / city, city).network.ids
    if set(ours) != {node.id for node in record.intersections}:
        raise UserError(
            field,
            name,
            f"that is the bundled dataset with {len(ours)} intersections from {ours[0]} to "
            f"{ours[-1]}, and this network has others; give it another name",
        )


def unknown_network(name: str) -> UserError:
    """The error for a name that is neither bundled nor imported nor a folder."""
    known = {*bundled_profiles(), *bundled_cities(), *imported_networks()}
    return UserError(FIELD, name, f"{nearest(name, known)}, or the path of a network folder")
