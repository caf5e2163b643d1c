"""Any SUMO net with signals as a ``NetworkRecord``: slots, phases, neighbours, sensors."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.sax import SAXException

import sumolib

from tsc_missing.errors import UserError, nearest
from tsc_missing.network.records import (
    IntersectionRecord,
    LaneRecord,
    LinkRecord,
    NetworkRecord,
    ReachRecord,
)
from tsc_missing.network.sumo_links import NO_SIGNALS, Signal, in_conflict, read_signal
from tsc_missing.network.sumo_phases import plan_phases

FIELD = "sumo-net"
REACH = 100.0  # [m] before the stop line that a sensor covers at least, over lanes upstream
UPSTREAM = 1500.0  # [m] that neighbours upstream are looked for
REACTION, BRAKING = 1.0, 3.0  # [s], [m/s2] for the yellow
SHORTEST_YELLOW = 3  # [s]
MIN_GREENS = ((8.5, 5), (18.0, 7), (math.inf, 10))  # up to speed [m/s]: [s]

Programs = Mapping[str, Sequence[str]]  # the states of the program that a signal starts with


@dataclass
class SumoNet:
    """A SUMO net that was read, and the signal programs that came with it.

    ``option`` and ``given`` are what a user named it by.
    """

    option: str
    given: Path
    net: Any
    left_hand: bool
    programs: dict[str, list[str]]
    notes: list[str] = field(default_factory=list)

    @cached_property
    def controlled(self) -> dict[tuple[str, str], str]:
        """The signal of each connection (lane, lane) that has one."""
        return {
            (start.getID(), end.getID()): light.getID()
            for light in self.net.getTrafficLights()
            for start, end, _ in light.getConnections()
        }


def open_net(
    path: Path, programs: Programs | None = None, name: str = FIELD, given: Path | None = None
) -> SumoNet:
    """Read a net, plain or gzipped; ``programs`` are those of additional files.

    ``UserError`` in the name of the option ``name``, and of the file ``given`` if that is another,
    if there is no net in it.
    """
    if not path.is_file():
        raise UserError(name, given or path, "there is no such file")
    try:
        net = sumolib.net.readNet(str(path), withPrograms=True, withFoes=True)
    except (SAXException, OSError, EOFError, KeyError, ValueError, UnicodeDecodeError) as error:
        what = " ".join(str(error).split())[:120]
        words = f"it cannot be read as a SUMO net ({what})"
        raise UserError(name, given or path, words) from None
    if not net.getEdges():
        words = "it must be a SUMO net (.net.xml), or an extract, with roads that cars may use"
        raise UserError(name, given or path, words)
    found: dict[str, list[str]] = {}
    for light in net.getTrafficLights():
        if not light.getConnections():  # none of vehicles
            continue
        own = [p for p in light.getPrograms().values() if p.getType() not in NO_SIGNALS]
        states = [phase.state for phase in own[-1].getPhases()] if own else []
        states = list((programs or {}).get(light.getID(), states))
        if states:
            found[light.getID()] = states
    return SumoNet(name, given or path, net, _left_hand(path), found)


def _left_hand(path: Path) -> bool:
    with sumolib.openz(str(path), "rb") as stream:
        _, root = next(ElementTree.iterparse(stream, events=("start",)))
    return root.get("lefthand") in ("true", "1", "yes", "on", "x", "t")


def compile_sumo(
    source: SumoNet,
    chosen: Collection[str] = (),
    all_phases: bool = False,
    near_side_free: bool = False,
) -> NetworkRecord:
    """The record of a SUMO net; of the signals only the ``chosen`` ones, if any are.

    With ``near_side_free`` turns to the near side are green in every phase where the junction's
    rules allow that, whatever the net's own program does.

    A signal with nothing to decide (one approach, or no conflicts) is left to its own program, and
    so are signals that share a junction; both are noted in ``source.notes``.
    """
    known = sorted(source.programs)
    for name in chosen:
        if name not in known:
            raise UserError("signals", name, nearest(name, known) if known else "there are none")
    if not known:
        raise UserError(source.option, source.given, "no junction in it has traffic signals")
    intersections, left_out = [], []
    together = in_conflict([source.net.getTLS(name) for name in known])
    for name in (name for name in known if not chosen or name in chosen):
        signal = read_signal(
            source.net.getTLS(name), source.programs[name], source.left_hand, near_side_free
        )
        node = _intersection(signal, all_phases)
        why = "another signal at its junction" if name in together else _nothing_to_decide(node)
        if why is None:
            intersections.append(node)
        elif chosen:
            raise UserError("signals", name, f"it must have phases to choose from, but has {why}")
        else:
            left_out.append(f"{name} ({why})")
    if not intersections:
        raise UserError(
            source.option,
            source.given,
            f"no signal in it has anything to decide: {', '.join(left_out)}",
        )
    source.notes += _notes(source, intersections, left_out, chosen)
    linked = {
        lane for node in intersections for k in node.links for lane in (k.from_lane, k.to_lane)
    }
    return NetworkRecord(
        intersections=tuple(intersections),
        lanes=_lanes(source, linked),
        upstream=_upstream(source, intersections),
        reach=_reach(source, intersections) or None,
        left_hand=source.left_hand or None,
    )


def _nothing_to_decide(node: IntersectionRecord) -> str | None:
    """Why an intersection needs no controller; None if it does."""
    if len(node.roads) < 2:
        return "one approach"
    return "no conflicts" if len(node.phases) < 2 else None


def _intersection(signal: Signal, all_phases: bool) -> IntersectionRecord:
    plan = plan_phases(signal, all_phases)
    places = tuple(link.place for link in signal.links)
    plain = places == tuple(range(signal.state_length))
    return IntersectionRecord(
        id=signal.id,
        x=signal.place[0],
        y=signal.place[1],
        roads=dict(signal.roads),
        links=tuple(
            LinkRecord(from_lane=k.from_lane, to_lane=k.to_lane, slot=k.slot) for k in signal.links
        ),
        foes=tuple(tuple(sorted(foes)) for foes in signal.foes),
        yields=plan.yields,
        phases=plan.phases,
        free=plan.free,
        positions=None if plain else places,
        state_length=None if plain else signal.state_length,
        yellow=yellow_for(signal.speed),
        min_green=next(green for most, green in MIN_GREENS if signal.speed <= most),
    )


def yellow_for(speed: float) -> int:
    """The yellow [s] for an approach speed [m/s]: t + v / 2a (ITE's formula), in whole seconds.

    With a reaction of 1 s and a deceleration of 3 m/s2 that is 4 s at 50 km/h.
    """
    return max(SHORTEST_YELLOW, math.ceil(REACTION + speed / (2 * BRAKING)))


def _lanes(source: SumoNet, linked: Collection[str]) -> dict[str, LaneRecord]:
    """All lanes of cars, buses and lorries, and the ``linked`` ones, whoever may use them."""
    return {
        lane.getID(): LaneRecord(
            road=edge.getID(),
            length=lane.getLength(),
            speed=max(lane.getSpeed(), 0.1),
            no_cars=None if lane.allows("passenger") else True,
            aside=None if carries_cars(lane) else True,
        )
        for edge in sorted(source.net.getEdges(), key=lambda edge: str(edge.getID()))
        for lane in edge.getLanes()
        if lane.getID() in linked or carries_cars(lane)
    }


def carries_cars(lane: Any) -> bool:
    """Whether cars, buses or lorries may use a lane."""
    return any(lane.allows(kind) for kind in ("passenger", "bus", "truck"))


def _upstream(
    source: SumoNet, intersections: Sequence[IntersectionRecord]
) -> dict[str, tuple[tuple[str, int], ...]]:
    """For each entrance road the slots whose movements feed it, the nearest first."""
    slots = {
        (link.from_lane, link.to_lane): (node.id, link.slot)
        for node in intersections
        for link in node.links
    }
    found = {}
    for node in intersections:
        for road in node.roads:
            rows: dict[tuple[str, int], float] = {}
            front, seen = [(0.0, road)], {road}
            while front:
                distance, name = front.pop(0)
                for before, connections in source.net.getEdge(name).getIncoming().items():
                    pairs = [(c.getFromLane().getID(), c.getToLane().getID()) for c in connections]
                    for pair in pairs:
                        if pair in slots and slots[pair][0] != node.id:
                            rows.setdefault(slots[pair], distance)
                    further = distance + before.getLength()
                    passed = any(pair not in source.controlled for pair in pairs)
                    if passed and before.getID() not in seen and further < UPSTREAM:
                        seen.add(before.getID())
                        front.append((further, before.getID()))
                front.sort()
            found[road] = tuple(sorted(rows, key=lambda slot: (rows[slot], slot)))
    return {road: found[road] for road in sorted(found)}


def _reach(
    source: SumoNet, intersections: Sequence[IntersectionRecord]
) -> dict[str, tuple[ReachRecord, ...]]:
    """For each entrance lane shorter than 100 m the lanes upstream, up to the next signal.

    A lane's vehicles count in equal parts for the lanes that it leads to.
    """
    entrances = sorted({link.from_lane for node in intersections for link in node.links})
    stops = {start for start, _ in source.controlled}
    found = {}
    for name in entrances:
        shares: dict[str, float] = {}
        distances: dict[str, float] = {}
        front = [(0.0, name, 1.0)]
        while front:
            distance, here, share = front.pop(0)
            lane = source.net.getLane(here)
            distance += lane.getLength()
            if distance >= REACH:
                continue
            for before in _lanes_before(lane):
                if before.getID() in stops or before.getID() == name or before.getID() in shares:
                    continue
                part = share / max(len({c.getToLane() for c in before.getOutgoing()}), 1)
                shares[before.getID()], distances[before.getID()] = part, distance
                front.append((distance, before.getID(), part))
        if shares:
            found[name] = tuple(
                ReachRecord(lane=k, distance=round(distances[k], 2), share=round(shares[k], 6))
                for k in shares
            )
    return found


def _lanes_before(lane: Any) -> list[Any]:
    """The lanes of cars that lead into a lane, by id."""
    found = {c.getFromLane() for c in lane.getIncomingConnections()}
    return sorted((k for k in found if carries_cars(k)), key=lambda k: str(k.getID()))


def _notes(
    source: SumoNet,
    intersections: Sequence[IntersectionRecord],
    left_out: Sequence[str],
    chosen: Collection[str],
) -> list[str]:
    notes = []
    if left_out:
        notes.append(f"signals that keep their own program: {', '.join(left_out)}")
    if chosen:
        others = len(source.programs) - len(intersections)
        if others:
            notes.append(f"{others} other signals keep their own program")
    crossings = sum(":" in k and "_c" in k for k in source.net._crossings_and_walkingAreas)
    if crossings:
        notes.append(f"pedestrians are ignored: {crossings} crossings are never given green")
    joined = [node.id for node in intersections if len(_junctions(source, node)) > 1]
    if joined:
        notes.append(f"signals that stand at several junctions: {', '.join(joined)}")
    many = [node.id for node in intersections if len(node.roads) > 4]
    if many:
        notes.append(f"more than four roads share the four approaches of: {', '.join(many)}")
    if source.left_hand:
        notes.append("traffic drives on the left; left turns are the near-side ones")
    return notes


def _junctions(source: SumoNet, node: IntersectionRecord) -> set[str]:
    return {source.net.getEdge(road).getToNode().getID() for road in node.roads}
