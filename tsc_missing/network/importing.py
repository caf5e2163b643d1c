"""From CityFlow files to a network folder."""

from pathlib import Path

from tsc_missing.config import VehicleType
from tsc_missing.demand.cityflow import other_vehicles, read_flow
from tsc_missing.demand.trips import write_routes
from tsc_missing.errors import UserError
from tsc_missing.files import sha256, whole_folder
from tsc_missing.network.cityflow import FIELD, read_roadnet
from tsc_missing.network.compile import compile_network, read_net
from tsc_missing.network.folder import (
    NET,
    RECORD,
    ROUTES,
    Manifest,
    builder_versions,
    check_dataset,
    write_manifest,
)
from tsc_missing.network.model import Network
from tsc_missing.network.netconvert import write_net
from tsc_missing.network.oddities import oddities
from tsc_missing.network.phase_check import conflicting_phases
from tsc_missing.network.plain import PlainNetwork
from tsc_missing.network.records import NetworkRecord, write_record


def build_network(plain: PlainNetwork, folder: Path) -> NetworkRecord:
    """Write the SUMO net of a plain network and its record into a folder."""
    write_net(plain, folder / NET)
    record = compile_network(read_net(folder / NET), plain)
    write_record(record, folder / RECORD)
    return record


def import_cityflow(
    roadnet: Path,
    flow: Path | None,
    target: Path,
    name: str,
    horizon: float,
    all_phases: bool = False,
    field: str = "out",
) -> Manifest:
    """Write a network folder from a CityFlow road network and, where given, a flow.

    Trips that depart before ``horizon`` [s] are kept. ``field`` names ``target`` in errors.
    Nothing is left behind when something is wrong with the files.
    """
    plain = read_roadnet(roadnet, all_phases)
    demand = read_flow(flow, plain, horizon) if flow is not None else None
    with whole_folder(target, field) as folder:
        record = build_network(plain, folder)
        for problem in conflicting_phases(record, plain):
            raise UserError(FIELD, roadnet, problem)
        check_dataset(target, name, record, field)
        if demand is not None:
            write_routes(demand, VehicleType(), folder / ROUTES)
        notes = list(oddities(Network(name, record)))
        others = other_vehicles(flow, VehicleType()) if flow is not None else []
        if others:
            notes.append(
                f"all vehicles are the run's own car, but the flow has {'; '.join(others)}"
            )
        manifest = Manifest(
            name=name,
            kind="cityflow",
            intersections=len(record.intersections),
            vehicles=len(demand.trips) if demand is not None else None,
            horizon=horizon if demand is not None else None,
            sources={path.name: sha256(path) for path in (roadnet, flow) if path is not None},
            versions=builder_versions(),
            notes=tuple(notes) or None,
        )
        write_manifest(folder, manifest)
    return manifest
