"""SUMO demand of any kind (trips, flows, vehicles) as trips with routes, through ``duarouter``."""

import re
import subprocess
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from tsc_missing.demand.sumo import read_routes
from tsc_missing.demand.trips import VEHICLE_TYPE_ID, Demand
from tsc_missing.errors import UserError
from tsc_missing.network.netconvert import sumo_tool

NO_CARS = ("person", "personFlow", "container", "containerFlow")  # are left out
OWN_ROUTES = ("vehicle", "trip", "flow", "route", "vType", "vTypeDistribution", "routeDistribution")
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
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory(prefix="tsc-") as scratch:
        inputs = []
        for number, path in enumerate(files):
            inputs.append(Path(scratch, f"{number}.rou.xml"))
            counts += _strip(path, inputs[-1], field)
        if not any(counts[kind] for kind in ("vehicle", "trip", "flow")):
            raise UserError(field, files[0], "there is no vehicle, trip or flow in it")
        routed = Path(scratch, "routed.rou.xml")
        problems = _duarouter(net, inputs, routed, begin, begin + horizon, seed)
        unknown = [line for line in problems if NO_EDGE.search(line)]
        demand = _read(routed, begin, horizon)
        if demand is None or (unknown and len(unknown) >= len(demand.trips)):
            raise _nothing(files[0], field, problems, unknown, begin, horizon)
    return Found(demand, tuple(_notes(counts, problems)))


def _strip(source: Path, target: Path, field: str) -> Counter[str]:
    """Copy a route file without what is no car's; returns how many elements of each kind it has."""
    try:
        tree = ElementTree.parse(source)
    except OSError as error:
        raise UserError(field, source, f"the file cannot be read ({error.strerror})") from None
    except ElementTree.ParseError as error:
        raise UserError(field, source, f"not valid XML ({error})") from None
    root = tree.getroot()
    if root.tag not in ("routes", "additional", "trips"):
        raise UserError(field, source, f"it must be a SUMO route file, not one of <{root.tag}>")
    root.attrib.clear()  # a schema's address would be looked up
    counts = Counter(child.tag for child in root)
    for child in [child for child in root if child.tag not in OWN_ROUTES]:
        root.remove(child)
    for child in root:
        for stop in child.findall("stop"):
            counts["stop"] += 1
            child.remove(stop)
        child.attrib.pop("arrival", None)
    tree.write(target, encoding="utf-8", xml_declaration=True)
    return counts


def _duarouter(
    net: Path, inputs: Sequence[Path], target: Path, begin: float, end: float, seed: int
) -> list[str]:
    """Route everything; returns the lines that duarouter complains in."""
    command = [
        sumo_tool("duarouter"),
        f"--net-file={net}",
        f"--route-files={','.join(map(str, inputs))}",
        f"--output-file={target}",
        f"--begin={begin:g}",
        f"--end={end:g}",
        f"--seed={seed}",
        "--skip-new-routes",
        "--ignore-errors",
        "--unsorted-input",
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
    renamed = f'"{VEHICLE_TYPE_ID}.recorded"'
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
    begin: float,
    horizon: float,
) -> UserError:
    if unknown:
        return UserError(field, path, f"it must be for this net, but: {_words(unknown[0])}")
    if problems:
        return UserError(field, path, f"none of it can be routed: {_words(problems[0])}")
    end = begin + horizon
    first = _first_departure(path)
    hint = f"; the first at {first:g} s, see --begin" if first is not None else ""
    return UserError(field, path, f"no vehicle in it departs from {begin:g} s to {end:g} s{hint}")


def _first_departure(path: Path) -> float | None:
    times = [
        float(value)
        for element in ElementTree.parse(path).getroot()
        for value in [element.get("depart", element.get("begin", ""))]
        if value.replace(".", "", 1).isdigit()
    ]
    return min(times, default=None)


def _words(line: str) -> str:
    return " ".join(line.removeprefix("Error:").removeprefix("Warning:").split()).rstrip(".;")


def _notes(counts: Counter[str], problems: Sequence[str]) -> list[str]:
    notes = [f"{counts[kind]} {kind} elements are left out" for kind in NO_CARS if counts[kind]]
    if counts["stop"]:
        notes.append(f"{counts['stop']} stops on the way (bus stops) are left out")
    lost = [line for line in problems if "No connection" in line or "has no valid route" in line]
    if problems:
        shown = _words((lost or problems)[0])
        notes.append(f"{len(problems)} complaints of duarouter, the first: {shown}")
    return notes
