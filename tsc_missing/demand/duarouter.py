"""SUMO demand of any kind (trips, flows, vehicles) as trips with routes, through ``duarouter``."""

import math
import re
import subprocess
import tempfile
from collections.abc import Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import sumolib

from tsc_missing.demand.given import NO_CARS, Given
from tsc_missing.demand.sumo import read_routes
from tsc_missing.demand.trips import NAMESAKE, VEHICLE_TYPE_ID, Demand
from tsc_missing.errors import UserError
from tsc_missing.network.netconvert import sumo_tool
from tsc_missing.words import counted

NO_EDGE = re.compile(r"not known|unknown", re.I)


@dataclass(frozen=True)
class Found:
    """The demand of route files, and what of them is not in it, in words."""

    demand: Demand
    notes: tuple[str, ...]


def route_demand(
    net: Path,
    files: Sequence[Path],
    begin: float,
    horizon: float,
    seed: int,
    field: str,
    additional: Sequence[Path] = (),
) -> Found:
    """The vehicles of SUMO route files that depart within ``horizon`` [s] after ``begin`` [s].

    Given routes stay as they are; trips and flows take the fastest ways of the empty network.
    Persons, containers and stops are left out. ``additional`` files come first; of these only the
    demand is looked at. Raises ``UserError`` in the name of ``field`` for
    files that are none, or that are for another net.
    """
    given = Given(begin, begin + horizon)
    for path in additional:
        given.add(path, field, additional=True)
    for path in files:
        given.add(path, field)
    files = [*additional, *files]
    if not given.traffic:
        when = " that a time starts" if given.untimed else ""
        raise UserError(field, files[0], f"there is no vehicle, trip or flow{when} in it")
    if given.lacking_zone is not None:
        words = f"its trips go between TAZ; give the file with the taz {given.lacking_zone} too"
        raise UserError(field, files[-1], f"{words}, as a further --routes")
    if given.lacking_type is not None:
        words = f"it has vehicles of type {given.lacking_type}, which no vType in the files defines"
        raise UserError(field, files[-1], words)
    strangers = given.leave_out_strangers(_roads(net))
    if not given.traffic:
        raise UserError(field, files[-1], f"it must be for this net, which has no {strangers[0]}")
    with tempfile.TemporaryDirectory(prefix="tsc-") as scratch:
        merged, routed = Path(scratch, "given.rou.xml"), Path(scratch, "routed.rou.xml")
        given.write(merged)
        more = []
        if given.zones:
            given.write_zones(Path(scratch, "zones.add.xml"))
            more.append(f"--additional-files={Path(scratch, 'zones.add.xml')}")
        problems = _duarouter(net, merged, routed, begin, begin + horizon, seed, more)
        unknown = [line for line in problems if NO_EDGE.search(line)]
        demand = _read(routed, begin, horizon)
        if demand is None or (unknown and len(unknown) >= len(demand.trips)):
            raise _nothing(files[-1], field, problems, unknown, given)
        kept = {e.get("id", "") for _, e in ElementTree.iterparse(routed) if e.tag == "vehicle"}
    notes = _notes(given, kept, problems)
    if strangers:
        what = "vehicles, trips and flows on roads that the net lacks"
        notes.insert(0, f"left out: {len(strangers)} {what}, first {strangers[0]}")
    return Found(demand, tuple(notes))


def _roads(net: Path) -> Set[str]:
    """The ids of a net's roads."""
    found = set()
    with sumolib.openz(str(net), "rb") as stream:
        for _, element in ElementTree.iterparse(stream):
            if element.tag == "edge":
                found.add(element.get("id", ""))
                element.clear()
    return found


def _duarouter(
    net: Path,
    given: Path,
    target: Path,
    begin: float,
    end: float,
    seed: int,
    options: Sequence[str],
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
        *options,
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
    path: Path, field: str, problems: Sequence[str], unknown: Sequence[str], given: Given
) -> UserError:
    if unknown:
        return UserError(field, path, f"it must be for this net, but: {_words(unknown[0])}")
    if problems and given.any_wanted:
        return UserError(field, path, f"none of it can be routed: {_words(problems[0])}")
    return UserError(
        field,
        path,
        f"no vehicle in it departs from {given.begin:g} s on within the horizon; its demand runs "
        f"{given.span}, see --begin",
    )


def _words(line: str) -> str:
    return " ".join(line.removeprefix("Error:").removeprefix("Warning:").split()).rstrip(".;")


def _notes(given: Given, kept: set[str], problems: Sequence[str]) -> list[str]:
    begin, end, counts = given.begin, given.end, given.counts
    notes = [
        f"left out: {counted(counts[kind], f'{kind} element')}" for kind in NO_CARS if counts[kind]
    ]
    notes += [
        f"left out: {counted(count, f'{tag} element')}" for tag, count in given.others.items()
    ]
    if given.untimed:
        vehicles = counted(len(given.untimed), "vehicle")
        notes.append(f"left out: {vehicles} that no time starts, first {given.untimed[0]}")
    if counts["stop"]:
        notes.append(f"left out: {counted(counts['stop'], 'stop')} on the way (bus stops)")
    departures = given.departures()
    outside = sum(not begin <= time < end for time in departures.values())
    if outside:
        late = f"departing before {begin:g} s or after {end:g} s"
        notes.append(f"left out: {counted(outside, 'vehicle')} {late}")
    notes += _flow_note(given)
    lost = [k for k, time in departures.items() if begin <= time < end and k not in kept]
    if lost:
        vehicles = counted(len(lost), "vehicle")
        notes.append(f"left out: {vehicles} without a way through the net, first {lost[0]}")
    if problems:
        lines = counted(len(problems), "line")
        notes.append(f"duarouter complained in {lines}, first: {_words(problems[0])}")
    return notes


def _flow_note(given: Given) -> list[str]:
    """How many flows lie outside the time that is wanted or reach beyond it, if any."""
    begin, end, flows = given.begin, given.end, given.flows()
    inside = [(first, last) for first, last in flows if first < end and last > begin]
    outside = len(flows) - len(inside)
    cut = sum(first < begin or end < last < math.inf for first, last in inside)
    if not outside + cut:
        return []
    return [
        f"flows: {len(flows)} in all, {outside} left out, {cut} cut; the demand given runs "
        f"{given.span}, imported is what departs from {begin:g} s to {end:g} s (--begin, --horizon)"
    ]
