"""What is odd about a network and its demand, in words."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict

from tsc_missing.config import RunSettings, VehicleType
from tsc_missing.controllers.fixed_time import critical_ratios
from tsc_missing.demand.generate import BIN, entry_warnings
from tsc_missing.demand.trips import Demand, turning_flows
from tsc_missing.network.folder import NetworkFolder
from tsc_missing.network.model import Network
from tsc_missing.network.oddities import APART, apart, crowded, unserved
from tsc_missing.network.records import IntersectionRecord
from tsc_missing.network.slots import LEFT, RIGHT, STRAIGHT, TURNS, slot_name

SHORT = 30.0  # [m]: an entrance lane that holds four cars
SHOWN = 5  # names a finding lists


class Finding(BaseModel):
    """Something odd: what it is about, and where."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    about: str
    text: str
    places: tuple[str, ...] = ()

    def __str__(self) -> str:
        """The text with the first places."""
        more = f" and {len(self.places) - SHOWN} more" if len(self.places) > SHOWN else ""
        where = f": {', '.join(self.places[:SHOWN])}{more}" if self.places else ""
        return f"{self.about}: {self.text}{where}"


def check_network(
    folder: NetworkFolder, demand: Demand | None, settings: RunSettings
) -> list[Finding]:
    """All that is odd, in the demand too if there is one."""
    import sumolib

    net = sumolib.net.readNet(str(folder.net_file), withPrograms=True)
    network = folder.network
    findings = [
        *_roads(net),
        *_signals(net, network),
        *_phases(network),
        *_lanes(net, network, settings.sensor.length),
        *(_demand(net, network, demand, settings) if demand is not None else []),
        *(Finding(about="import", text=note) for note in folder.manifest.notes or ()),
    ]
    return [finding for finding in findings if finding.places or finding.about == "import"]


def _find(about: str, text: str, places: Iterable[str]) -> Finding:
    return Finding(about=about, text=text, places=tuple(dict.fromkeys(places)))


def _roads(net: Any) -> list[Finding]:
    """Roads for cars that no vehicle can come to from outside, or leave to outside."""
    roads = [edge for edge in net.getEdges() if edge.allows("passenger")]
    entries = [edge for edge in roads if edge.is_fringe(edge.getIncoming())]
    exits = [edge for edge in roads if edge.is_fringe(edge.getOutgoing())]
    reached = _spread(entries, lambda edge: edge.getOutgoing())
    leaving = _spread(exits, lambda edge: edge.getIncoming())
    names = sorted(edge.getID() for edge in roads)
    return [
        _find(
            "roads",
            "no vehicle that enters at the edge of the network can reach",
            (k for k in names if k not in reached) if entries else (),
        ),
        _find(
            "roads",
            "there is no way out of the network from",
            (k for k in names if k not in leaving) if exits else (),
        ),
    ]


def _spread(start: Iterable[Any], following: Any) -> set[str]:
    front = list(start)
    seen = {edge.getID() for edge in front}
    while front:
        for edge in following(front.pop()):
            if edge.getID() not in seen:
                seen.add(edge.getID())
                front.append(edge)
    return seen


def _signals(net: Any, network: Network) -> list[Finding]:
    controlled = set(network.ids)
    others = sorted(light.getID() for light in net.getTrafficLights())
    near = network.adjacency
    return [
        _find(
            "signals",
            "keep the net's own program, no controller decides for",
            (name for name in others if name not in controlled),
        ),
        _find(
            "signals",
            "no other controlled signal is near",
            (network.ids[n] for n in range(network.n) if network.n > 1 and not near[n].any()),
        ),
        _find(
            "signals",
            "more than four roads share four approaches at",
            crowded(network),
        ),
    ]


def _phases(network: Network) -> list[Finding]:
    shadowed, gentle = [], []
    for n, node in enumerate(network.intersections):
        table = network.phases[n, : len(node.phases)]
        for p, phase in enumerate(node.phases):
            if any(
                not (table[p] & ~table[q]).any() and (q < p or (table[q] & ~table[p]).any())
                for q in range(len(table))
                if q != p
            ):
                shadowed.append(f"{node.id} {phase.name}")
            for i in phase.links:
                if _waits_for_gaps(network, node, i, phase.links):
                    gentle.append(f"{node.id} {slot_name(node.links[i].slot)}")
    return [
        _find("phases", "no phase serves", unserved(network)),
        _find("phases", APART, apart(network)),
        _find(
            "phases",
            "starve, because another phase serves all that they do: a controller that scores "
            "phases by what they serve never chooses",
            shadowed,
        ),
        _find(
            "phases",
            "turns across the oncoming traffic that share a lane and so wait for gaps in it",
            gentle,
        ),
    ]


def _waits_for_gaps(
    network: Network, node: IntersectionRecord, link: int, green: Sequence[int]
) -> bool:
    """Whether a link turns left or right across straight traffic that is green too."""
    lanes = network.record.lanes
    across = RIGHT if network.record.left_hand else LEFT

    def turn(k: int) -> int:
        return node.links[k].slot % len(TURNS)

    def road(k: int) -> str:
        return lanes[node.links[k].from_lane].road

    return turn(link) == across and any(
        k in node.yields[link] and turn(k) == STRAIGHT and road(k) != road(link) for k in green
    )


def _lanes(net: Any, network: Network, detector: float) -> list[Finding]:
    lanes, reach = network.record.lanes, network.reach
    entrances = network.entrance_lanes
    roads = {road for node in network.intersections for road in node.roads}
    dead = [
        lane.getID()
        for road in sorted(roads)
        for lane in net.getEdge(road).getLanes()
        if not lane.getOutgoing() and lane.allows("passenger")
    ]
    return [
        _find(
            "sensors",
            f"lanes longer than an area detector of {detector:g} m, which does not see all of",
            (k for k in entrances if lanes[k].length > detector),
        ),
        _find(
            "sensors",
            f"shorter than {SHORT:g} m, and nothing upstream that the sensor could cover too",
            (k for k in entrances if lanes[k].length < SHORT and k not in reach),
        ),
        _find("lanes", "lead nowhere at a signal", dead),
    ]


def _demand(net: Any, network: Network, demand: Demand, settings: RunSettings) -> list[Finding]:
    trips, horizon = demand.trips, settings.horizon
    flows = turning_flows(trips, network, min(horizon, demand.span))
    load = critical_ratios(network, flows).sum(axis=1)
    idle = [
        f"{node.id} {phase.name}"
        for n, node in enumerate(network.intersections)
        for p, phase in enumerate(node.phases)
        if not flows[n][network.phases[n, p]].any()
    ]
    known = {edge.getID() for edge in net.getEdges()}
    bins = -(-horizon // BIN)
    arrivals: dict[str, list[float]] = {}
    for trip in trips:
        row = arrivals.setdefault(trip.route[0], [0.0] * bins)
        row[min(int(trip.depart // BIN), bins - 1)] += 1
    speeds = {k: [a.getSpeed() for a in net.getEdge(k).getLanes()] for k in arrivals if k in known}
    full = entry_warnings({k: arrivals[k] for k in speeds}, speeds, VehicleType())
    return [
        _find(
            "demand",
            "roads of routes that are not in the net",
            (road for trip in trips for road in trip.route if road not in known),
        ),
        _find("demand", "no vehicle wants to use any movement of", idle),
        _find("demand", "in some five minutes more wants to enter than the lanes take", full),
        _find(
            "demand",
            "more wants to pass than any fixed plan lets through (flow over capacity)",
            (f"{network.ids[n]} {load[n]:.2f}" for n in np.flatnonzero(load > 1.0)),
        ),
    ]
