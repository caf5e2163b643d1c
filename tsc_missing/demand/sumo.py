"""SUMO route files as trips."""

from pathlib import Path
from xml.etree import ElementTree

from tsc_missing.demand.trips import Demand, Trip
from tsc_missing.errors import UserError

FIELD = "routes"


def read_routes(path: Path, horizon: float) -> Demand:
    """The vehicles of a SUMO route file that depart before ``horizon`` [s]."""
    routes: dict[str, tuple[str, ...]] = {}
    trips = []
    try:
        for _, element in ElementTree.iterparse(path):
            if element.tag == "route":
                routes[element.get("id", "")] = tuple(element.get("edges", "").split())
            elif element.tag == "vehicle":
                depart = float(element.get("depart", "nan"))
                if depart < horizon:
                    trips.append(Trip(depart, routes[element.get("route", "")]))
    except (ElementTree.ParseError, ValueError, KeyError) as error:
        raise UserError(FIELD, path, f"not a route file that can be read ({error})") from None
    if not trips:
        raise UserError(FIELD, path, f"no vehicle in it departs before {horizon:g} s")
    return Demand.of(trips, "recorded")
