"""Trips: who enters where, when, and by which roads; and their SUMO route file."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import numpy.typing as npt

from tsc_missing.config import VehicleType
from tsc_missing.network.model import Network
from tsc_missing.network.slots import N_SLOTS

VEHICLE_TYPE_ID = "car"


@dataclass(frozen=True)
class Trip:
    """One vehicle: its scheduled departure [s] and the roads of its route."""

    depart: float
    route: tuple[str, ...]


@dataclass(frozen=True)
class Demand:
    """All trips of a scenario, sorted by departure, and where they come from."""

    trips: tuple[Trip, ...]
    source: str  # "recorded" or "profile"

    @classmethod
    def of(cls, trips: Iterable[Trip], source: str) -> "Demand":
        """A demand of trips in any order; equal departures keep the order given."""
        return cls(tuple(sorted(trips, key=lambda trip: trip.depart)), source)


def turning_flows(
    demand: Sequence[Trip], network: Network, horizon: float
) -> npt.NDArray[np.float64]:
    """(N, 12): vehicles per hour that the trips departing within ``horizon`` [s] send to a slot.

    This is the turning count that a signal plan is designed with: the volume that wants to pass,
    whether or not it can.
    """
    slot_of: dict[tuple[str, str], int] = {}
    lanes = network.record.lanes
    for n, node in enumerate(network.intersections):
        for link in node.links:
            roads = (lanes[link.from_lane].road, lanes[link.to_lane].road)
            slot_of[roads] = n * N_SLOTS + link.slot
    counts = np.zeros(network.n * N_SLOTS)
    for trip in demand:
        if trip.depart < horizon:
            for pair in zip(trip.route, trip.route[1:], strict=False):
                if pair in slot_of:
                    counts[slot_of[pair]] += 1.0
    return counts.reshape(network.n, N_SLOTS) * 3600.0 / horizon


def write_routes(demand: Demand, vehicle: VehicleType, target: Path) -> None:
    """Write a SUMO route file: one vehicle type, each distinct route once, a vehicle a trip.

    Vehicles are named by their position in the demand, so that trip k is vehicle ``"k"``.
    """
    routes: dict[tuple[str, ...], int] = {}
    vehicles = []
    for number, trip in enumerate(demand.trips):
        route = routes.setdefault(trip.route, len(routes))
        vehicles.append(
            f'<vehicle id="{number}" type="{VEHICLE_TYPE_ID}" route="r{route}" '
            f'depart="{trip.depart:.2f}" departLane="{vehicle.depart_lane}" '
            f'departSpeed="{vehicle.depart_speed}" departPos="{vehicle.depart_pos}"/>'
        )
    listed = [
        f'<route id="r{number}" edges={quoteattr(" ".join(roads))}/>'
        for roads, number in routes.items()
    ]
    lines = ["<routes>", vehicle.as_xml(VEHICLE_TYPE_ID), *listed, *vehicles, "</routes>", ""]
    target.write_text("\n".join(lines), encoding="utf-8")
