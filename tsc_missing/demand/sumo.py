"""SUMO route files as trips: those that this project wrote, or that duarouter did."""

from pathlib import Path
from xml.etree import ElementTree

from tsc_missing.demand.trips import DEFAULT_TYPE, VEHICLE_TYPE_ID, Attributes, Demand, Trip
from tsc_missing.errors import UserError
from tsc_missing.network.sumo_files import check_scale

FIELD = "routes"
# Attributes of a vehicle that are not kept as they are; its zones are in its route:
OURS = {"id", "depart", "route", "arrival", "fromTaz", "toTaz"}


def read_routes(path: Path, horizon: float, begin: float = 0.0) -> Demand:
    """The vehicles of a SUMO route file that depart within ``horizon`` [s] after ``begin`` [s].

    Trips count from the begin. A vehicle keeps its id as the trip's name, and its further
    attributes if its type is not the project's own car.
    """
    routes: dict[str, tuple[str, ...]] = {}
    types: dict[str, str] = {}
    known: dict[Attributes, Attributes] = {}
    trips = []
    try:
        for _, element in ElementTree.iterparse(path):
            if element.tag == "route":
                routes[element.get("id", "")] = tuple(element.get("edges", "").split())
            elif element.tag == "vType":
                kind = element.get("id", "")
                check_scale(element.get("scale", ""), f"vType {kind}", path, FIELD)
                types[kind] = _as_text(element)
            elif element.tag == "vehicle":
                depart = round(float(element.get("depart", "nan")) - begin, 3)
                if 0 <= depart < horizon:
                    how: Attributes | None = None
                    if element.get("type") != VEHICLE_TYPE_ID:
                        how = tuple((k, v) for k, v in element.items() if k not in OURS)
                        how = known.setdefault(how, how)
                    trips.append(Trip(depart, _route(element, routes), how, element.get("id")))
                element.clear()
    except (ElementTree.ParseError, ValueError, KeyError) as error:
        raise UserError(FIELD, path, f"not a route file that can be read ({error})") from None
    if not trips:
        raise UserError(FIELD, path, f"no vehicle in it departs before {horizon:g} s")
    used = {trip.written_type or DEFAULT_TYPE for trip in trips}
    return Demand.of(trips, (text for name, text in types.items() if name in used))


def _route(vehicle: ElementTree.Element, routes: dict[str, tuple[str, ...]]) -> tuple[str, ...]:
    own = vehicle.find("route")
    return (
        tuple(own.get("edges", "").split()) if own is not None else routes[vehicle.get("route", "")]
    )


def _as_text(element: ElementTree.Element) -> str:
    element.tail = None
    return ElementTree.tostring(element, encoding="unicode")
