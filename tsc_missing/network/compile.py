"""From a SUMO net to ``network.json``: links, conflicts, phases and upstream movements."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import sumolib

from tsc_missing.network.plain import Node, PlainNetwork
from tsc_missing.network.records import (
    IntersectionRecord,
    LaneRecord,
    LinkRecord,
    NetworkRecord,
    PhaseRecord,
)
from tsc_missing.network.slots import RIGHT_OF_WAY, TURNS, assign_approaches, slot_index
from tsc_missing.network.sumo_links import request_bit

LinkKey = tuple[str, int, str, int]  # from road, from lane, to road, to lane


def read_net(path: Path) -> Any:
    """The net as sumolib reads it, with signal programs and conflicts."""
    return sumolib.net.readNet(str(path), withPrograms=True, withFoes=True)


def road_conflicts(net: Any) -> set[tuple[str, str, str, str]]:
    """Pairs of road-to-road turns (from, to, from, to) that conflict at some junction."""
    pairs = set()
    for node in net.getNodes():
        turns = [
            (
                connection.getFrom().getID(),
                connection.getTo().getID(),
                node.getLinkIndex(connection),
            )
            for edge in node.getIncoming()
            for connections in edge.getOutgoing().values()
            for connection in connections
        ]
        turns = [turn for turn in turns if turn[2] >= 0]
        for first in turns:
            for second in turns:
                if first[0] != second[0] and node.areFoes(first[2], second[2]):
                    pairs.add((*first[:2], *second[:2]))
    return pairs


def compile_network(net: Any, plain: PlainNetwork) -> NetworkRecord:
    """The record of a net that was built from ``plain``."""
    turns = _turns(plain)
    signalised = [node for node in plain.nodes.values() if node.signalised]
    approaches = {node.id: _approaches(node, plain) for node in signalised}
    intersections = tuple(
        _intersection(net, node, approaches[node.id], turns) for node in signalised
    )
    lanes = {
        lane.getID(): LaneRecord(road=edge.getID(), length=lane.getLength(), speed=lane.getSpeed())
        for edge in sorted(net.getEdges(), key=lambda edge: str(edge.getID()))
        for lane in edge.getLanes()
    }
    return NetworkRecord(
        intersections=intersections, lanes=lanes, upstream=_upstream(plain, approaches)
    )


def _turns(plain: PlainNetwork) -> dict[LinkKey, int]:
    return {
        (move.from_road, start, move.to_road, end): move.turn
        for node in plain.nodes.values()
        for move in node.movements
        for start, end in move.lane_pairs
    }


def _approaches(node: Node, plain: PlainNetwork) -> dict[str, int]:
    """The approach of each incoming road that has movements, by where its traffic comes from."""
    incoming = sorted({move.from_road for move in node.movements})
    bearings = [plain.comes_from(node, road) for road in incoming]
    return dict(zip(incoming, assign_approaches(bearings), strict=True))


def _slot(approaches: Mapping[str, int], road: str, turn: int) -> int:
    """The slot of a turn from a road; roads that share an approach have one of its slots each."""
    approach = approaches[road]
    sharing = sorted(name for name, other in approaches.items() if other == approach)
    if len(sharing) == 1:
        return slot_index(approach, turn)
    return slot_index(approach, min(sharing.index(road), len(TURNS) - 1))


def _intersection(
    net: Any, node: Node, approaches: Mapping[str, int], turns: Mapping[LinkKey, int]
) -> IntersectionRecord:
    light, junction = net.getTLS(node.id), net.getNode(node.id)
    ordered = sorted(light.getConnections(), key=lambda connection: int(connection[2]))
    keys: list[LinkKey] = []
    links = []
    requests = []
    for in_lane, out_lane, _ in ordered:
        start, end = in_lane.getEdge(), out_lane.getEdge()
        key = (start.getID(), in_lane.getIndex(), end.getID(), out_lane.getIndex())
        keys.append(key)
        slot = _slot(approaches, start.getID(), turns[key])
        links.append(LinkRecord(from_lane=in_lane.getID(), to_lane=out_lane.getID(), slot=slot))
        connection = next(c for c in in_lane.getOutgoing() if c.getToLane() == out_lane)
        requests.append(junction.getLinkIndex(connection))
    everything = range(len(links))

    def waits(i: int, j: int) -> bool:
        return request_bit(junction._prohibits, requests[i], requests[j])

    def conflict(i: int, j: int) -> bool:
        if keys[i][0] != keys[j][0]:
            return bool(junction.areFoes(requests[i], requests[j]))
        return waits(i, j) or waits(j, i)  # traffic of one road sorts itself out but for these

    foes = tuple(tuple(j for j in everything if i != j and conflict(i, j)) for i in everything)
    ranks = [RIGHT_OF_WAY[turns[key]] for key in keys]
    yields = tuple(
        tuple(
            j for j in foes[i] if (waits(i, j) if keys[i][0] == keys[j][0] else ranks[j] < ranks[i])
        )
        for i in everything
    )

    def links_of(movements: tuple[int, ...]) -> tuple[int, ...]:
        wanted = {(node.movements[m].from_road, node.movements[m].to_road) for m in movements}
        return tuple(i for i in everything if (keys[i][0], keys[i][2]) in wanted)

    return IntersectionRecord(
        id=node.id,
        x=node.x,
        y=node.y,
        roads=dict(approaches),
        links=tuple(links),
        foes=foes,
        yields=yields,
        phases=tuple(
            PhaseRecord(name=phase.name, links=links_of(phase.movements)) for phase in node.phases
        ),
        free=links_of(node.free),
    )


def _upstream(
    plain: PlainNetwork, approaches: Mapping[str, Mapping[str, int]]
) -> dict[str, tuple[tuple[str, int], ...]]:
    """For each road the signalised movements that feed it, through junctions without signals."""
    feeders: dict[str, list[tuple[Node, str, int]]] = {}
    for node in plain.nodes.values():
        for move in node.movements:
            feeders.setdefault(move.to_road, []).append((node, move.from_road, move.turn))
    found = {}
    for road in plain.roads:
        slots: set[tuple[str, int]] = set()
        seen, front = {road}, [road]
        while front:
            for node, source, turn in feeders.get(front.pop(), []):
                if node.signalised:
                    slots.add((node.id, _slot(approaches[node.id], source, turn)))
                elif source not in seen:
                    seen.add(source)
                    front.append(source)
        found[road] = tuple(sorted(slots))
    return found
