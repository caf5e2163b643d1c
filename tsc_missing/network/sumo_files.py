"""SUMO's files around a net: configurations, and the signal programs of additional files."""

import zlib
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.etree import ElementTree

import sumolib

from tsc_missing.errors import UserError
from tsc_missing.network.sumo_links import NO_SIGNALS

FIELD = "sumo-net"
CONFIGURATION = ".sumocfg"
TRAFFIC = ("vehicle", "trip", "flow")
ZONES = "taz"
DEMAND = (*TRAFFIC, "route", "vType", "vTypeDistribution", "routeDistribution", ZONES)
RATES = ("period", "perHour", "vehsPerHour", "probability")
WRAPPERS = ("tazs", "interval")  # around elements that could stand for themselves


@dataclass(frozen=True)
class SumoFiles:
    """What a SUMO scenario is made of; ``begin`` and ``end`` [s] where a configuration says so."""

    net: Path
    routes: tuple[Path, ...] = ()
    additional: tuple[Path, ...] = ()
    begin: float | None = None
    end: float | None = None

    @property
    def all(self) -> tuple[Path, ...]:
        """All files."""
        return (self.net, *self.routes, *self.additional)


@dataclass
class Additional:
    """What is kept of additional files: signal programs, and files that hold demand or types.

    A program without phases only shifts one that is in the net.
    """

    programs: list[ElementTree.Element] = field(default_factory=list)
    demand: list[Path] = field(default_factory=list)
    has_traffic: bool = False
    left_out: Counter[str] = field(default_factory=Counter)

    @property
    def states(self) -> dict[str, list[str]]:
        """The states of each signal's program that has phases; the last one counts."""
        return {
            logic.get("id", ""): [phase.get("state", "") for phase in logic.iter("phase")]
            for logic in self.programs
            if logic.find("phase") is not None
        }


def find_files(given: Path) -> SumoFiles:
    """The files of a net, or those that a configuration (``.sumocfg``) names."""
    if not given.is_file():
        raise UserError(FIELD, given, "there is no such file")
    if given.suffix != CONFIGURATION:
        return SumoFiles(given)
    root = parse_xml(given)
    values = {element.tag: element.get("value", element.get("v", "")) for element in root.iter()}

    def paths(*names: str) -> tuple[Path, ...]:
        text = next((values[name] for name in names if values.get(name)), "")
        return tuple(given.parent / part.strip() for part in text.split(",") if part.strip())

    nets = paths("net-file", "net")
    if not nets:
        raise UserError(FIELD, given, "it must name a net-file")
    files = SumoFiles(
        nets[0], paths("route-files", "routes"), paths("additional-files", "additional")
    )
    for path in files.all:
        if not path.is_file():
            raise UserError(FIELD, given, f"it names {path}, which is not there")
    check_scale(values.get("scale", ""), "its demand", given, FIELD)
    return replace(
        files, begin=_seconds(values, "begin", given), end=_seconds(values, "end", given)
    )


def check_scale(text: str, whose: str, path: Path, field: str) -> None:
    """Raise ``UserError`` for a factor on the number of vehicles, which nothing here applies."""
    if text.strip() and not _is_one(text):
        words = f"{whose} has a scale of {text}; only 1 is read: give the vehicles themselves"
        raise UserError(field, path, words)


def _is_one(text: str) -> bool:
    try:
        return float(text) == 1.0
    except ValueError:
        return False


def _seconds(values: dict[str, str], name: str, path: Path) -> float | None:
    """The time of that name; None where there is none, or one below 0."""
    text = values.get(name, "").strip()
    if not text:
        return None
    try:
        seconds = seconds_of(text)
    except ValueError:
        raise UserError(FIELD, path, f"{name} must be a time, not {text!r}") from None
    return seconds if seconds >= 0 else None


def seconds_of(text: str) -> float:
    """A time as SUMO writes it [s]: seconds, or (days:)hours:minutes:seconds; ``ValueError``."""
    parts = [float(part) for part in text.split(":")]
    units = (1.0, 60.0, 3600.0, 86400.0)
    if len(parts) > len(units) or len(parts) == 2:
        raise ValueError(f"no time: {text}")
    return sum(part * unit for part, unit in zip(reversed(parts), units, strict=False))


def read_additional(paths: tuple[Path, ...]) -> Additional:
    """The signal programs of additional files, and which of the files hold demand."""
    found = Additional()
    for path in paths:
        children = read_elements(path)[1]
        if any(child.tag in DEMAND for child in children):
            found.demand.append(path)
        found.has_traffic |= any(child.tag in TRAFFIC for child in children)
        for child in children:
            if child.tag == "tlLogic" and child.get("type") not in NO_SIGNALS:
                found.programs.append(child)
            elif child.tag not in DEMAND:
                found.left_out[child.tag] += 1
    return found


def write_programs(additional: Additional, target: Path) -> None:
    """Write the signal programs as one additional file, if there are any."""
    if additional.programs:
        root = ElementTree.Element("additional")
        root.extend(additional.programs)
        ElementTree.ElementTree(root).write(target, encoding="utf-8")


def read_elements(path: Path, field: str = FIELD) -> tuple[str, list[ElementTree.Element]]:
    """The tag of a file's root, and its elements with those of the files that it includes.

    Elements in an ``interval`` are given its times, as far as they say none.
    """
    return _elements(path, field, ())


def _elements(
    path: Path, field: str, including: tuple[Path, ...]
) -> tuple[str, list[ElementTree.Element]]:
    if path.resolve() in including:
        raise UserError(field, path, "it includes itself")
    root = parse_xml(path, field)
    found = []
    for child in root:
        if child.tag == "include":
            further = path.parent / child.get("href", "")
            found += _elements(further, field, (*including, path.resolve()))[1]
        elif child.tag in WRAPPERS:
            found += [_with_times(part, child) for part in child]
        else:
            found.append(child)
    return root.tag, found


def _with_times(element: ElementTree.Element, interval: ElementTree.Element) -> ElementTree.Element:
    """A flow with the begin and end of the interval that it is in."""
    if element.tag == "flow":
        closed = "number" in element.attrib and set(RATES) & set(element.attrib)
        for name in ("begin",) if closed else ("begin", "end"):
            if name in interval.attrib:
                element.attrib.setdefault(name, interval.attrib[name])
    return element


def parse_xml(path: Path, field: str = FIELD) -> ElementTree.Element:
    """The root of an XML file, plain or gzipped; ``UserError`` in the name of ``field``."""
    try:
        with sumolib.openz(str(path), "rb") as stream:
            return ElementTree.parse(stream).getroot()
    except (OSError, EOFError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or "damaged"
        raise UserError(field, path, f"the file cannot be read ({reason})") from None
    except ElementTree.ParseError as error:
        raise UserError(field, path, f"not valid XML ({error})") from None
