"""What a SUMO net says of a signal: its links, their conflicts, and which it never stops."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from tsc_missing.network.slots import (
    LEFT,
    RIGHT,
    STRAIGHT,
    assign_approaches,
    bearing,
    slot_index,
)

BACK = 30.0  # [m] of road before the stop line that give the direction traffic comes from
TURN_OF_DIRECTION = {
    "l": LEFT, "L": LEFT, "s": STRAIGHT, "r": RIGHT, "R": RIGHT,
    "t": LEFT, "T": RIGHT,
}  # fmt: skip
U_TURNS = ("t", "T")  # with traffic on the right, on the left
NO_SIGNALS = ("rail_signal", "rail_crossing", "off")  # types of programs that are no signals
STOPS = "ru"  # letters of SUMO's states with which a link may not be passed


@dataclass(frozen=True)
class Link:
    """A connection that a signal controls."""

    from_lane: str
    to_lane: str
    road: str  # of ``from_lane``
    slot: int
    turn: int  # left, straight or right; the slot's, but where roads had to share an approach
    place: int  # in SUMO's state string
    turns_back: bool
    near: bool  # turns to the near side, so across no oncoming traffic
    stopped: bool  # the net's own program stops it in some phase
    whole_road: bool = False  # all that comes by its road goes together, and has one slot


@dataclass(frozen=True)
class Signal:
    """A traffic light: its links in the order of their places, and which of them conflict.

    ``foes[i]`` are the links that link i conflicts with, ``gives_way[i]`` those of them that the
    junction's rules make it give way to.
    """

    id: str
    place: tuple[float, float]  # x, y [m]
    roads: Mapping[str, int]  # the approach of each incoming road
    links: tuple[Link, ...]
    foes: tuple[frozenset[int], ...]
    gives_way: tuple[frozenset[int], ...]
    state_length: int
    speed: float  # [m/s], the highest limit of its entrance lanes


def read_signal(
    light: Any, program: Sequence[str], left_hand: bool, near_side_free: bool = False
) -> Signal:
    """A traffic light of a sumolib net with the states of its program.

    With ``near_side_free`` the program counts as never stopping turns to the near side.
    """
    connections = sorted(
        (_connection(start, end, place) for start, end, place in light.getConnections()),
        key=lambda found: (found.getTLLinkIndex(), *_sorting(found)),
    )
    roads = {c.getFrom().getID(): c.getFrom() for c in connections}
    approaches = _approaches(roads)
    turns = {name: _turns(road, left_hand) for name, road in roads.items()}
    links = tuple(_link(c, approaches, turns, program, left_hand) for c in connections)
    if near_side_free:
        links = tuple(replace(link, stopped=link.stopped and not link.near) for link in links)
    foes, gives_way = _conflicts(connections)
    links = _share_approaches(links, foes, approaches)
    nodes = {road.getToNode() for road in roads.values()}
    places = [node.getCoord()[:2] for node in nodes]
    return Signal(
        id=light.getID(),
        place=(sum(x for x, _ in places) / len(places), sum(y for _, y in places) / len(places)),
        roads=approaches,
        links=links,
        foes=foes,
        gives_way=gives_way,
        state_length=max([*map(len, program), *(link.place + 1 for link in links)]),
        speed=max(c.getFromLane().getSpeed() for c in connections),
    )


def in_conflict(lights: Sequence[Any]) -> set[str]:
    """The lights that share a junction with another of them, and links of both conflict there."""
    at: dict[Any, list[tuple[str, int]]] = {}
    for light in lights:
        for start, end, place in light.getConnections():
            connection = _connection(start, end, place)
            node = connection.getJunction()
            at.setdefault(node, []).append((light.getID(), node.getLinkIndex(connection)))
    found = set()
    for node, links in at.items():
        for (one, request), (other, counterpart) in itertools.combinations(links, 2):
            if one != other and any(
                request_bit(table, *pair)
                for table in (node._prohibits, node._foes)
                for pair in ((request, counterpart), (counterpart, request))
            ):
                found |= {one, other}
    return found


def _connection(start: Any, end: Any, place: int) -> Any:
    return next(
        c for c in start.getOutgoing() if c.getToLane() == end and c.getTLLinkIndex() == place
    )


def _sorting(connection: Any) -> tuple[str, int, str, int]:
    start, end = connection.getFromLane(), connection.getToLane()
    return start.getEdge().getID(), start.getIndex(), end.getEdge().getID(), end.getIndex()


def _approaches(roads: Mapping[str, Any]) -> dict[str, int]:
    """The approach of each road, by where its traffic comes from at the stop line.

    Of a signal at several junctions the roads between them take the approach of the road from
    outside whose direction is nearest to theirs.
    """
    nodes = {road.getToNode() for road in roads.values()}
    outer = sorted(name for name, road in roads.items() if road.getFromNode() not in nodes)
    outer = outer or sorted(roads)
    bearings = {name: _comes_from(road) for name, road in roads.items()}
    found = dict(zip(outer, assign_approaches([bearings[name] for name in outer]), strict=True))
    for name in sorted(set(roads) - set(outer)):
        nearest = min(outer, key=lambda other: _apart(bearings[name], bearings[other]))
        found[name] = found[nearest]
    return {name: found[name] for name in sorted(found)}


def _comes_from(road: Any) -> float:
    """The compass bearing [degrees] from the stop line back along the road."""
    points = [point[:2] for point in reversed(road.getLanes()[0].getShape())]
    (end_x, end_y), (x, y), left = points[0], points[-1], BACK
    for (ax, ay), (bx, by) in itertools.pairwise(points):
        length = ((bx - ax) ** 2 + (by - ay) ** 2) ** 0.5
        if length >= left > 0:
            x, y = ax + (bx - ax) * left / length, ay + (by - ay) * left / length
            break
        left -= length
    return bearing(x - end_x, y - end_y)


def _apart(first: float, second: float) -> float:
    difference = abs(first - second) % 360.0
    return min(difference, 360.0 - difference)


def _turns(road: Any, left_hand: bool) -> dict[str, int]:
    """The turn that each of the net's directions is at the end of a road.

    Where nothing goes straight on, a half turn beside another turn to the same side does.
    """
    found = {c.getDirection() for cs in road.getOutgoing().values() for c in cs}
    turns = dict(TURN_OF_DIRECTION)
    turns |= dict.fromkeys(U_TURNS, RIGHT if left_hand else LEFT)
    if "s" not in found:
        half = [name for name in ("L", "R") if name in found and name.lower() in found]
        turns.update(dict.fromkeys(half[:1], STRAIGHT))
    return turns


def _link(
    connection: Any,
    approaches: Mapping[str, int],
    turns: Mapping[str, Mapping[str, int]],
    program: Sequence[str],
    left_hand: bool,
) -> Link:
    road, direction = connection.getFrom().getID(), connection.getDirection()
    turn = turns[road].get(direction, STRAIGHT)
    turns_back = direction in U_TURNS
    place = int(connection.getTLLinkIndex())
    letters = {state[place] for state in program if place < len(state)}
    return Link(
        from_lane=connection.getFromLane().getID(),
        to_lane=connection.getToLane().getID(),
        road=road,
        slot=slot_index(approaches[road], turn),
        turn=turn,
        place=place,
        turns_back=turns_back,
        near=not turns_back and turn == (LEFT if left_hand else RIGHT),
        stopped=not letters or bool(letters & set(STOPS)),
    )


def _conflicts(
    connections: Sequence[Any],
) -> tuple[tuple[frozenset[int], ...], tuple[frozenset[int], ...]]:
    """For each link its foes, and those of them it gives way to, by the junctions' rules."""
    places = [(c.getJunction(), c.getJunction().getLinkIndex(c)) for c in connections]
    foes: list[set[int]] = [set() for _ in connections]
    gives_way: list[set[int]] = [set() for _ in connections]
    for i, (node, request) in enumerate(places):
        for j, (other, counterpart) in enumerate(places):
            if node != other or i == j:
                continue
            waits = request_bit(node._prohibits, request, counterpart)
            if waits or request_bit(node._foes, request, counterpart):
                foes[i].add(j)
                foes[j].add(i)
            if waits:
                gives_way[i].add(j)
    for i, link in enumerate(connections):  # traffic of one lane or road sorts itself out
        own = {j for j in foes[i] if connections[j].getFrom() == link.getFrom()}
        foes[i] -= {j for j in own if not (j in gives_way[i] or i in gives_way[j])}
    return tuple(map(frozenset, foes)), tuple(map(frozenset, gives_way))


def _share_approaches(
    links: tuple[Link, ...], foes: Sequence[frozenset[int]], approaches: Mapping[str, int]
) -> tuple[Link, ...]:
    """Where roads that share an approach cross each other, each as a whole gets one of its slots.

    Else two phases would serve the same slots, and a controller could not tell them apart. The
    widest road gets the slot straight, the next left, and what is left the slot right.
    """
    slots: dict[str, int] = {}
    for approach in sorted(set(approaches.values())):
        roads = sorted(road for road, found in approaches.items() if found == approach)
        if any(
            links[i].road != links[j].road and _cross(links[i], links[j])
            for i, link in enumerate(links)
            if link.road in roads
            for j in foes[i]
            if links[j].road in roads
        ):
            lanes = {road: len({k.from_lane for k in links if k.road == road}) for road in roads}
            for rank, road in enumerate(sorted(roads, key=lambda road: (-lanes[road], road))):
                turn = (STRAIGHT, LEFT, RIGHT)[min(rank, 2)]
                slots[road] = slot_index(approach, turn)
    return tuple(
        replace(link, slot=slots[link.road], whole_road=True) if link.road in slots else link
        for link in links
    )


def _cross(first: Link, second: Link) -> bool:
    """Whether two links that conflict do more than merge, and none only turns aside."""
    aside = any(link.near or link.turns_back for link in (first, second))
    return not aside and first.to_lane.rsplit("_", 1)[0] != second.to_lane.rsplit("_", 1)[0]


def request_bit(table: Mapping[int, str], row: int, column: int) -> bool:
    """A bit of a junction's requests, which SUMO writes from the last link to the first."""
    bits = table.get(row, "")
    return column < len(bits) and bits[len(bits) - 1 - column] == "1"
