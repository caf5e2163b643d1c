"""From SUMO files or an OSM extract to a network folder."""

import math
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

import sumolib

from tsc_missing.config import VehicleType
from tsc_missing.demand.duarouter import Found, route_demand
from tsc_missing.demand.generate import DemandSpec, generate_through_net
from tsc_missing.demand.trips import write_routes
from tsc_missing.errors import UserError
from tsc_missing.files import sha256, whole_folder
from tsc_missing.network.folder import (
    NET,
    RECORD,
    ROUTES,
    SIGNALS,
    Manifest,
    builder_versions,
    check_dataset,
    write_manifest,
)
from tsc_missing.network.osm import convert_osm
from tsc_missing.network.records import write_record
from tsc_missing.network.sumo import SumoNet, compile_sumo, open_net
from tsc_missing.network.sumo_files import (
    Additional,
    SumoFiles,
    find_files,
    read_additional,
    write_programs,
)

HORIZON = 3600.0  # [s], where nothing says another


@dataclass(frozen=True)
class SumoImport:
    """What to import: a SUMO net or configuration, or an OSM extract, and how."""

    source: Path
    kind: Literal["sumo", "osm"] = "sumo"
    routes: tuple[Path, ...] = ()  # beside those of a configuration
    signals: tuple[str, ...] = ()  # those to control; none: all
    begin: float | None = None  # [s]; None: the configuration's, or 0
    horizon: float | None = None  # [s]; None: the configuration's, or an hour
    all_phases: bool = False
    demand: DemandSpec | None = None  # to generate, where no routes are given
    seed: int = 0
    left_hand: bool = False  # of an OSM extract, which does not say on which side traffic drives

    @property
    def field(self) -> str:
        """The option that names the source."""
        return "osm" if self.kind == "osm" else "sumo-net"

    def named(self, files: SumoFiles) -> Path:
        """The file to name in errors about the net."""
        return self.source if self.kind == "osm" else files.net


def import_sumo(wanted: SumoImport, target: Path, name: str, field: str = "out") -> Manifest:
    """Write a network folder; ``field`` names ``target`` in errors.

    Nothing is left behind when something is wrong with the files.
    """
    if wanted.begin is not None and not 0 <= wanted.begin < math.inf:
        raise UserError("begin", wanted.begin, "it must be a number of seconds, 0 or more")
    with tempfile.TemporaryDirectory(prefix="tsc-") as scratch:
        files = _files(wanted, Path(scratch))
        additional = read_additional(files.additional)
        source = open_net(files.net, additional.states, wanted.field, wanted.named(files))
        record = compile_sumo(source, wanted.signals, wanted.all_phases)
        check_dataset(target, name, record, field)
        begin, horizon = _times(wanted, files)
        found = _demand(wanted, files, additional, source, begin, horizon)
        left_out = [f"{n} {kind}" for kind, n in sorted(additional.left_out.items())]
        if left_out:
            source.notes.append(f"of the additional files left out: {', '.join(left_out)}")
        with whole_folder(target, field) as folder:
            _copy_net(files.net, folder / NET)
            write_record(record, folder / RECORD)
            write_programs(additional, folder / SIGNALS)
            if found is not None:
                write_routes(found.demand, VehicleType(), folder / ROUTES, begin, named=True)
            sources = [wanted.source, *files.all, *wanted.routes]
            if wanted.kind == "osm":
                sources.remove(files.net)
            manifest = Manifest(
                name=name,
                kind=wanted.kind,
                intersections=len(record.intersections),
                vehicles=len(found.demand.trips) if found is not None else None,
                demand="generated" if found is not None and wanted.demand is not None else None,
                begin=begin or None,
                horizon=horizon if found is not None else None,
                notes=(*source.notes, *(found.notes if found is not None else ())) or None,
                sources={path.name: sha256(path) for path in sources},
                versions=builder_versions(),
            )
            write_manifest(folder, manifest)
    return manifest


def _files(wanted: SumoImport, scratch: Path) -> SumoFiles:
    if wanted.kind == "osm":
        net = scratch / "osm.net.xml"
        convert_osm(wanted.source, net, wanted.left_hand)
        return SumoFiles(net)
    return find_files(wanted.source)


def _times(wanted: SumoImport, files: SumoFiles) -> tuple[float, float]:
    """When the scenario begins, and for how long it lasts [s]."""
    begin = wanted.begin if wanted.begin is not None else files.begin or 0.0
    if wanted.horizon is not None:
        return begin, wanted.horizon
    if files.end is not None and files.end > begin:
        return begin, files.end - begin
    return begin, HORIZON


def _demand(
    wanted: SumoImport,
    files: SumoFiles,
    additional: Additional,
    source: SumoNet,
    begin: float,
    horizon: float,
) -> Found | None:
    routes = [*files.routes, *wanted.routes]
    there = bool(files.routes or wanted.routes or additional.has_traffic)
    if wanted.demand is not None:
        if there:
            raise UserError(
                "vehicles-per-hour",
                wanted.demand.vehicles_per_hour,
                "it cannot go with routes, which say the demand already",
            )
        return generate_through_net(
            source.net, files.net, wanted.demand, begin, horizon, wanted.seed
        )
    if not there:
        return None
    return route_demand(files.net, routes, begin, horizon, wanted.seed, "routes", additional.demand)


def _copy_net(source: Path, target: Path) -> None:
    """Copy a net, plain or gzipped, to a plain file, without what switches signal programs."""
    with sumolib.openz(str(source), "rb") as packed, target.open("wb") as plain:
        shutil.copyfileobj(packed, plain)
    if b"<WAUT" in target.read_bytes():
        tree = ElementTree.parse(target)
        root = tree.getroot()
        for element in [*root.findall("WAUT"), *root.findall("wautJunction")]:
            root.remove(element)
        tree.write(target, encoding="UTF-8", xml_declaration=True)
