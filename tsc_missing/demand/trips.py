"""Trips: who enters where, when, and by which roads; and their SUMO route file."""

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import numpy.typing as npt

from tsc_missing.config import VehicleType
from tsc_missing.network.model import IntArray, Network
from tsc_missing.network.slots import N_SLOTS

VEHICLE_TYPE_ID = "car"
DEFAULT_TYPE = "DEFAULT_VEHTYPE"  # SUMO's name for the type of vehicles that name none
NAMESAKE = f"{VEHICLE_TYPE_ID}.recorded"  # how a source's type of that name is written

Attributes = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Trip:
    """One vehicle: its scheduled departure [s] after the begin and the roads of its route.

    ``attributes`` are SUMO's further ones (type, departLane, …); None: the run's own car. ``name``
    is what the source calls it, if it does.
    """

    depart: float
    route: tuple[str, ...]
    attributes: Attributes | None = None
    name: str | None = field(default=None, compare=False)

    @property
    def type(self) -> str:
        """The id of its vehicle type, as the source has it; empty where that says none."""
        if self.written_type in (None, NAMESAKE):
            return VEHICLE_TYPE_ID
        return self.written_type

    @property
    def written_type(self) -> str | None:
        """The id of its vehicle type in route files; None: the run's own car."""
        return None if self.attributes is None else dict(self.attributes).get("type", "")


@dataclass(frozen=True)
class Demand:
    """All trips of a scenario, sorted by departure.

    ``types`` are the vehicle types that trips with attributes name, as SUMO's XML elements.
    """

    trips: tuple[Trip, ...]
    types: tuple[str, ...] = ()
    duration: float = math.inf  # [s] after the begin that the source says it lasts, if it does

    @property
    def span(self) -> float:
        """How long vehicles depart [s]: what the source says, but no longer than it is true.

        An import may have read up to a time that its files do not reach. Demands come in hours,
        so the one of the last departure is whole.
        """
        last = self.trips[-1].depart if self.trips else 0.0
        return min(self.duration, 3600.0 * (last // 3600.0 + 1.0))

    @classmethod
    def of(cls, trips: Iterable[Trip], types: Iterable[str] = ()) -> "Demand":
        """A demand of trips in any order; equal departures keep the order given."""
        return cls(tuple(sorted(trips, key=lambda trip: trip.depart)), tuple(types))


def slots_of_turns(network: Network) -> dict[tuple[str, str], int]:
    """The flat slot of each pair of roads that follow each other over a signal."""
    lanes = network.record.lanes
    return {
        (lanes[link.from_lane].road, lanes[link.to_lane].road): n * N_SLOTS + link.slot
        for n, node in enumerate(network.intersections)
        for link in node.links
    }


def first_slots(trips: Sequence[Trip], network: Network) -> IntArray:
    """(M,): the flat slot by which each trip passes its first signal, -1 where it passes none."""
    slot_of = slots_of_turns(network)
    first: dict[tuple[str, ...], int] = {}
    for trip in trips:
        if trip.route not in first:
            pairs = itertools.pairwise(trip.route)
            first[trip.route] = next((slot_of[pair] for pair in pairs if pair in slot_of), -1)
    return np.array([first[trip.route] for trip in trips], dtype=np.int64)


def turning_flows(
    demand: Sequence[Trip], network: Network, horizon: float
) -> npt.NDArray[np.float64]:
    """(N, 12): vehicles per hour that the trips departing within ``horizon`` [s] send to a slot.

    The mean over ``horizon``, which should not be longer than there is demand.

    This is the turning count that a signal plan is designed with: the volume that wants to pass,
    whether or not it can.
    """
    slot_of = slots_of_turns(network)
    counts = np.zeros(network.n * N_SLOTS)
    for trip in demand:
        if trip.depart < horizon:
            for pair in zip(trip.route, trip.route[1:], strict=False):
                if pair in slot_of:
                    counts[slot_of[pair]] += 1.0
    return counts.reshape(network.n, N_SLOTS) * 3600.0 / horizon


def write_routes(
    demand: Demand, vehicle: VehicleType, target: Path, begin: float = 0.0, named: bool = False
) -> None:
    """Write a SUMO route file: the vehicle types, each distinct route once, a vehicle a trip.

    Vehicles are named by their position in the demand, so that trip k is vehicle ``"k"``, or with
    ``named`` as their source calls them, if it does so with all. ``vehicle`` is the car of the
    trips without attributes; departures are written after ``begin`` [s].
    """
    routes: dict[tuple[str, ...], int] = {}
    vehicles = []
    written: dict[Attributes | None, tuple[str, str]] = {None: _written(_as_attributes(vehicle))}
    own_names = named and len({trip.name for trip in demand.trips}) == len(demand.trips)
    for number, trip in enumerate(demand.trips):
        name = quoteattr(trip.name) if own_names and trip.name else f'"{number}"'
        route = routes.setdefault(trip.route, len(routes))
        if trip.attributes not in written:
            written[trip.attributes] = _written(trip.attributes or ())
        kind, how = written[trip.attributes]
        vehicles.append(
            f'<vehicle id={name}{kind} route="r{route}" depart="{begin + trip.depart:.2f}"{how}/>'
        )
    ours = any(trip.attributes is None for trip in demand.trips)
    car = [vehicle.as_xml(VEHICLE_TYPE_ID)] if ours else []
    listed = [
        f'<route id="r{number}" edges={quoteattr(" ".join(roads))}/>'
        for roads, number in routes.items()
    ]
    lines = ["<routes>", *car, *demand.types, *listed, *vehicles, "</routes>", ""]
    target.write_text("\n".join(lines), encoding="utf-8")


def _written(attributes: Attributes) -> tuple[str, str]:
    """The vehicle's type and its other attributes as XML, each with a blank before it."""
    kind = "".join(f" {k}={quoteattr(v)}" for k, v in attributes if k == "type")
    return kind, "".join(f" {k}={quoteattr(v)}" for k, v in attributes if k != "type")


def _as_attributes(vehicle: VehicleType) -> Attributes:
    return (
        ("type", VEHICLE_TYPE_ID),
        ("departLane", vehicle.depart_lane),
        ("departSpeed", vehicle.depart_speed),
        ("departPos", vehicle.depart_pos),
    )
