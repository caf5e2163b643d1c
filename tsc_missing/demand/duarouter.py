"""SUMO demand of any kind (trips, flows, vehicles) as trips with routes, through ``duarouter``."""

import dataclasses
import math
import re
import subprocess
import tempfile
from collections import Counter
from collections.abc import Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import sumolib

from tsc_missing.demand.sumo import read_routes
from tsc_missing.demand.trips import NAMESAKE, VEHICLE_TYPE_ID, Demand
from tsc_missing.errors import UserError
from tsc_missing.network.netconvert import sumo_tool
from tsc_missing.network.sumo_files import parse_xml, seconds_of

NO_CARS = ("person", "personFlow", "container", "containerFlow")  # are left out
TRAFFIC = ("vehicle", "trip", "flow")
ORDER = ("vType", "vTypeDistribution", "route", "routeDistribution", *TRAFFIC)
NO_EDGE = re.compile(r"not known|unknown", re.I)


@dataclass(frozen=True)
class Found:
    """The demand of route files, and what of them is not in it, in words."""

    demand: Demand
    notes: tuple[str, ...]


def route_demand(
    net: Path, files: Sequence[Path], begin: float, horizon: float, seed: int, field: str
) -> Found:
    """The vehicles of SUMO route files that depart within ``horizon`` [s] after ``begin`` [s].

    Given routes stay as they are; trips and flows take the fastest ways of the empty network.
    Persons, containers and stops are left out. Raises ``UserError`` in the name of ``field`` for
    files that are none, or that are for another net.
    """
    given = Given()
    for path in files:
        given.add(path, field)
    if not given.traffic:
        raise UserError(field, files[0], "there is no vehicle, trip or flow in it")
    strangers = given.leave_out_strangers(_roads(net))
    if not given.traffic:
        raise UserError(field, files[-1], f"it must be for this net, which has no {strangers[0]}")
    with tempfile.TemporaryDirectory(prefix="tsc-") as scratch:
        merged, routed = Path(scratch, "given.rou.xml"), Path(scratch, "routed.rou.xml")
        given.write(merged)
        problems = _duarouter(net, merged, routed, begin, begin + horizon, seed)
        unknown = [line for line in problems if NO_EDGE.search(line)]
        demand = _read(routed, begin, horizon)
        if demand is None or (unknown and len(unknown) >= len(demand.trips)):
            raise _nothing(files[-1], field, problems, unknown, given, begin)
        kept = {e.get("id", "") for _, e in ElementTree.iterparse(routed) if e.tag == "vehicle"}
    notes = _notes(given, kept, problems, begin, begin + horizon)
    if strangers:
        lost = f"{len(strangers)} vehicles, trips or flows name roads that the net lacks"
        notes.insert(0, f"{lost} and are left out, first {strangers[0]}")
    return Found(demand, tuple(notes))


@dataclass
class Given:
    """What route files hold, with types before routes before traffic, sorted by departure."""

    elements: list[ElementTree.Element] = dataclasses.field(default_factory=list)
    counts: Counter[str] = dataclasses.field(default_factory=Counter)

    def add(self, path: Path, field: str) -> None:
        """Take in a file, without what is no car's."""
        root = parse_xml(path, field)
        if root.tag not in ("routes", "additional", "trips"):
            raise UserError(field, path, f"it must be a SUMO route file, not one of <{root.tag}>")
        self.counts.update(child.tag for child in root)
        for child in root:
            if child.tag in ORDER:
                for stop in child.findall("stop"):
                    self.counts["stop"] += 1
                    child.remove(stop)
                child.attrib.pop("arrival", None)
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

    def departures(self) -> dict[str, float]:
        """When single vehicles depart [s], by id, as far as a time says so."""
        return {
            element.get("id", ""): _seconds(element)
            for element in self.traffic
            if element.tag != "flow"
        }

    def write(self, target: Path) -> None:
        """Write all of it as one route file."""
        root = ElementTree.Element("routes")
        definitions = (e for e in self.elements if e.tag not in TRAFFIC)
        root.extend(sorted(definitions, key=lambda e: ORDER.index(e.tag)))
        root.extend(sorted(self.traffic, key=_seconds))
        ElementTree.ElementTree(root).write(target, encoding="utf-8", xml_declaration=True)


def _roads(net: Path) -> Set[str]:
    """The ids of a net's roads."""
    found = set()
    with sumolib.openz(str(net), "rb") as stream:
        for _, element in ElementTree.iterparse(stream):
            if element.tag == "edge":
                found.add(element.get("id", ""))
                element.clear()
    return found


def _stranger(element: ElementTree.Element, roads: Set[str]) -> str | None:
    """A road that the element names, or its route does, and that is none of these."""
    own = element.find("route")
    named = [element.get("from", ""), element.get("to", ""), *element.get("via", "").split()]
    named += element.get("edges", "").split()
    named += own.get("edges", "").split() if own is not None else []
    return next((road for road in named if road and road not in roads), None)


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
        return seconds_of(element.get("end", "inf"))
    except ValueError:
        return math.inf


def _duarouter(
    net: Path, given: Path, target: Path, begin: float, end: float, seed: int
) -> list[str]:
    """Route everything; returns the lines that duarouter complains in."""
    command = [
        sumo_tool("duarouter"),
        f"--net-file={net}",
        f"--route-files={given}",
        f"--output-file={target}",
        f"--begin={begin:.2f}",
        f"--end={end:.2f}",
        f"--seed={seed}",
        "--skip-new-routes",
        "--ignore-errors",
        "--no-step-log",
        "--xml-validation=never",
        "--xml-validation.net=never",
        "--xml-validation.routes=never",
    ]
    result = subprocess.run(command, capture_output=True, text=True)
    lines = [line.strip() for line in result.stderr.splitlines()]
    return [line for line in lines if line.startswith(("Error", "Warning"))]


def _read(path: Path, begin: float, horizon: float) -> Demand | None:
    if not path.is_file():
        return None
    try:
        demand = read_routes(path, horizon, begin)
    except UserError:
        return None
    return _without_clash(path, demand, begin, horizon)


def _without_clash(path: Path, demand: Demand, begin: float, horizon: float) -> Demand:
    """A type that is called as the project's own car gets another name."""
    text = path.read_text(encoding="utf-8")
    own = f'"{VEHICLE_TYPE_ID}"'
    if f"id={own}" not in text and f"type={own}" not in text:
        return demand
    renamed = f'"{NAMESAKE}"'
    text = text.replace(f"type={own}", f"type={renamed}").replace(
        f"<vType id={own}", f"<vType id={renamed}"
    )
    path.write_text(text, encoding="utf-8")
    return read_routes(path, horizon, begin)


def _nothing(
    path: Path,
    field: str,
    problems: Sequence[str],
    unknown: Sequence[str],
    given: Given,
    begin: float,
) -> UserError:
    if unknown:
        return UserError(field, path, f"it must be for this net, but: {_words(unknown[0])}")
    first, last = min(map(_seconds, given.traffic)), max(map(_ends, given.traffic))
    if problems and last >= begin:
        return UserError(field, path, f"none of it can be routed: {_words(problems[0])}")
    return UserError(
        field,
        path,
        f"no vehicle in it departs from {begin:g} s on within the horizon; the first departs at "
        f"{first:g} s, the last at {last:g} s, see --begin",
    )


def _words(line: str) -> str:
    return " ".join(line.removeprefix("Error:").removeprefix("Warning:").split()).rstrip(".;")


def _notes(
    given: Given, kept: set[str], problems: Sequence[str], begin: float, end: float
) -> list[str]:
    counts = given.counts
    notes = [f"{counts[kind]} {kind} elements are left out" for kind in NO_CARS if counts[kind]]
    if counts["stop"]:
        notes.append(f"{counts['stop']} stops on the way (bus stops) are left out")
    departures = given.departures()
    outside = sum(not begin <= time < end for time in departures.values())
    if outside:
        notes.append(
            f"{outside} vehicles that depart before {begin:g} s or after {end:g} s are left out"
        )
    lost = [k for k, time in departures.items() if begin <= time < end and k not in kept]
    if lost:
        notes.append(
            f"{len(lost)} vehicles have no way through the net and are left out, as {lost[0]}"
        )
    if problems:
        notes.append(f"duarouter complained in {len(problems)} lines, first: {_words(problems[0])}")
    return notes
