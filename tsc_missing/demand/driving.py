"""How the vehicles of a demand drive, as a traffic engineer would know it of a town's."""

import math
from collections import Counter
from dataclasses import dataclass
from xml.etree import ElementTree

from tsc_missing.config import VehicleType
from tsc_missing.demand.trips import DEFAULT_TYPE, Demand

SUMO_TAU = 1.0  # [s] and
SUMO_SPEED = 55.55  # [m/s], of a vehicle type that does not say


@dataclass(frozen=True)
class Driving:
    """Means over the vehicles."""

    tau: float  # [s] wished from the bumper before to one's own
    max_speed: float  # [m/s], where the road allows it


def driving_of(demand: Demand, vehicle: VehicleType) -> Driving:
    """The mean over a demand's trips; ``vehicle`` is the car of those without a type."""
    found: dict[str | None, tuple[float, float]] = {None: (vehicle.tau, vehicle.max_speed)}
    for text in demand.types:
        kind = ElementTree.fromstring(text)
        found[kind.get("id")] = (
            _number(kind.get("tau"), SUMO_TAU),
            _number(kind.get("maxSpeed"), SUMO_SPEED),
        )
    used = Counter(trip.written_type for trip in demand.trips)
    if not used:
        return Driving(vehicle.tau, vehicle.max_speed)
    otherwise = (SUMO_TAU, SUMO_SPEED)
    found.setdefault("", found.get(DEFAULT_TYPE, otherwise))
    parts = [(count, *found.get(name, otherwise)) for name, count in used.items()]
    total = sum(used.values())
    return Driving(
        tau=sum(count * tau for count, tau, _ in parts) / total,
        max_speed=sum(count * speed for count, _, speed in parts) / total,
    )


def _number(text: str | None, otherwise: float) -> float:
    """What a type says, if that is a number above 0."""
    try:
        found = float(text or "")
    except ValueError:
        return otherwise
    return found if 0 < found < math.inf else otherwise
