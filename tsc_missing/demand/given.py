"""What SUMO route files hold, as ``duarouter`` is to read it, and when it departs."""

import copy
import dataclasses
import math
import re
from collections import Counter
from collections.abc import Set
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from tsc_missing.errors import UserError
from tsc_missing.network.sumo_files import (
    TRAFFIC,
    ZONES,
    check_scale,
    read_elements,
    seconds_of,
)

NO_CARS = ("person", "personFlow", "container", "containerFlow")  # are left out
TYPES = ("vType", "vTypeDistribution")
OWN_TYPE = re.compile(r"DEFAULT_[A-Z]+TYPE")  # of SUMO
ROUTES = ("route", "routeDistribution")
ORDER = (*TYPES, *ROUTES, *TRAFFIC)


@dataclass
class Given:
    """What route files hold, with types before routes before traffic, sorted by departure.

    What departs from ``begin`` [s] to ``end`` [s] is wanted; flows that do not say when they begin
    do so then.
    """

    begin: float
    end: float
    elements: list[ElementTree.Element] = dataclasses.field(default_factory=list)
    zones: list[ElementTree.Element] = dataclasses.field(default_factory=list)
    counts: Counter[str] = dataclasses.field(default_factory=Counter)
    others: Counter[str] = dataclasses.field(default_factory=Counter)  # unknown elements, by tag
    untimed: list[str] = dataclasses.field(default_factory=list)  # vehicles that no time starts

    def add(self, path: Path, field: str, additional: bool = False) -> None:
        """Take in a file, without what is no car's.

        Of an ``additional`` one somebody else says what is not taken in.
        """
        tag, children = read_elements(path, field)
        if tag not in ("routes", "additional", "trips"):
            raise UserError(field, path, f"it must be a SUMO route file, not one of <{tag}>")
        self.counts.update(child.tag for child in children)
        for child in children:
            if child.tag in ORDER:
                self._add(child, path, field)
            elif child.tag == ZONES:
                self.zones.append(child)
            elif child.tag not in NO_CARS and not additional:
                self.others[child.tag] += 1

    def _add(self, child: ElementTree.Element, path: Path, field: str) -> None:
        for kind in child.iter("vType"):
            check_scale(kind.get("scale", ""), f"vType {kind.get('id')}", path, field)
        for stop in child.findall("stop"):
            self.counts["stop"] += 1
            child.remove(stop)
        child.attrib.pop("arrival", None)
        if child.tag == "flow":
            child.attrib.setdefault("begin", f"{self.begin:.2f}")
        elif child.tag in TRAFFIC:
            if child.get("depart") == "begin":
                child.set("depart", f"{self.begin:.2f}")
            if not _is_time(child.get("depart", "")):
                self.untimed.append(child.get("id", ""))
                return
        self.elements.append(child)

    @property
    def traffic(self) -> list[ElementTree.Element]:
        """The vehicles, trips and flows."""
        return [element for element in self.elements if element.tag in TRAFFIC]

    def leave_out_strangers(self, roads: Set[str]) -> list[str]:
        """Drop traffic that names roads of another net, which duarouter would cut off there.

        Returns the first such road of each.
        """
        strange = {
            element.get("id"): road
            for element in self.elements
            if element.tag == "route" and (road := _stranger(element, roads))
        }
        strange.pop(None, None)  # nobody can drive a route without a name
        found, kept = [], []
        for element in self.elements:
            road = strange.get(element.get("route")) or _stranger(element, roads)
            if element.tag in TRAFFIC and road:
                found.append(road)
            elif not (element.tag == "route" and road):
                kept.append(element)
        self.elements = kept
        return found

    @property
    def lacking_zone(self) -> str | None:
        """A zone (TAZ) that traffic needs, as it says no road, and that is not there."""
        known = {zone.get("id") for zone in self.zones}
        named = (
            element.get(f"{end}Taz")
            for element in self.traffic
            for end in ("from", "to")
            if end not in element.attrib and not _has_route(element)
        )
        return next((zone for zone in named if zone is not None and zone not in known), None)

    @property
    def lacking_type(self) -> str | None:
        """A vehicle type that traffic names and that is not there, nor one of SUMO's own."""
        definitions = (e for e in self.elements if e.tag in TYPES)
        known = {kind.get("id") for e in definitions for kind in e.iter() if kind.tag in TYPES}
        named = (e.get("type") for e in self.traffic)
        return next((k for k in named if k and k not in known and not OWN_TYPE.fullmatch(k)), None)

    def departures(self) -> dict[str, float]:
        """When single vehicles depart [s], by id, as far as a time says so."""
        return {
            element.get("id", ""): _seconds(element)
            for element in self.traffic
            if element.tag != "flow"
        }

    def flows(self) -> list[tuple[float, float]]:
        """When the flows begin and end [s]."""
        return [(_seconds(flow), _ends(flow)) for flow in self.traffic if flow.tag == "flow"]

    @property
    def any_wanted(self) -> bool:
        """Whether anything departs in the time that is wanted."""
        return any(_seconds(e) < self.end and _ends(e) >= self.begin for e in self.traffic)

    @property
    def span(self) -> str:
        """From when to when there is traffic, in words."""
        first, last = min(map(_seconds, self.traffic)), max(map(_ends, self.traffic))
        return f"from {first:g} s " + ("on" if math.isinf(last) else f"to {last:g} s")

    def write(self, target: Path) -> None:
        """Write all of it as one route file, without what duarouter cannot read."""
        root = ElementTree.Element("routes")
        definitions = (e for e in self.elements if e.tag not in TRAFFIC)
        root.extend(sorted(definitions, key=lambda e: ORDER.index(e.tag)))
        readable = (_readable(element, self.begin, self.end) for element in self.traffic)
        root.extend(sorted((e for e in readable if e is not None), key=_seconds))
        ElementTree.ElementTree(root).write(target, encoding="utf-8", xml_declaration=True)

    def write_zones(self, target: Path) -> None:
        """Write the traffic assignment zones as an additional file."""
        root = ElementTree.Element("additional")
        root.extend(self.zones)
        ElementTree.ElementTree(root).write(target, encoding="utf-8", xml_declaration=True)


def _stranger(element: ElementTree.Element, roads: Set[str]) -> str | None:
    """A road that the element names, or its route does, and that is none of these."""
    own = element.find("route")
    named = [element.get("from", ""), element.get("to", ""), *element.get("via", "").split()]
    named += element.get("edges", "").split()
    named += own.get("edges", "").split() if own is not None else []
    return next((road for road in named if road and road not in roads), None)


def _has_route(element: ElementTree.Element) -> bool:
    return "route" in element.attrib or any(e.tag in ROUTES for e in element)


def _is_time(text: str) -> bool:
    try:
        return math.isfinite(seconds_of(text))
    except ValueError:
        return False


def _seconds(element: ElementTree.Element) -> float:
    """The departure of a vehicle, or the begin of a flow [s]; 0 where it is no time."""
    try:
        return seconds_of(element.get("depart", element.get("begin", "0")))
    except ValueError:
        return 0.0


def _ends(element: ElementTree.Element) -> float:
    """When a flow ends, or the departure of a vehicle [s]; for ever where it does not say."""
    if element.tag != "flow":
        return _seconds(element)
    try:
        if "end" in element.attrib:
            return seconds_of(element.attrib["end"])
        hourly = element.get("perHour", element.get("vehsPerHour"))
        headway = 3600.0 / float(hourly) if hourly else seconds_of(element.get("period", "inf"))
        return _seconds(element) + float(element.get("number", "inf")) * headway
    except (ValueError, ZeroDivisionError):
        return math.inf


def _readable(element: ElementTree.Element, begin: float, end: float) -> ElementTree.Element | None:
    """The traffic as duarouter can route it from ``begin`` to ``end`` [s]; None if it cannot.

    It stops at a flow that begins later and does not say when it ends, and never comes to an end
    with one of a ``probability`` that began before. Such a flow draws every second anew, so it may
    as well begin then, if it is not over.
    """
    if element.tag != "flow":
        return element
    if _seconds(element) >= end:
        return None
    if "probability" not in element.attrib or _seconds(element) >= begin:
        return element
    if _ends(element) <= begin:
        return None
    later = copy.deepcopy(element)
    later.set("begin", f"{begin:.2f}")
    return later
