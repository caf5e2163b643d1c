"""CityFlow road networks (``roadnet.json``) as plain networks.

CityFlow numbers lanes from the innermost (lane 0, usually the left turn) outward; SUMO from the
outermost inward, so CityFlow lane i of n is SUMO lane n - 1 - i.
"""

from collections import Counter
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BaseModel, Field, TypeAdapter

from tsc_missing.errors import UserError
from tsc_missing.files import parse, read_json
from tsc_missing.network.plain import Lane, Movement, Node, Phase, PlainNetwork, Road
from tsc_missing.network.slots import LEFT, RIGHT, STRAIGHT

TURN_OF_TYPE = {"turn_left": LEFT, "go_straight": STRAIGHT, "turn_right": RIGHT, "turn_u": LEFT}
FIELD = "roadnet"

Positive = Annotated[float, Field(gt=0)]


NOT_IN_IDS = "@$%^&/|\\{}*'\";:<>,"  # of roads and junctions in SUMO, and no blanks


def _usable(name: str) -> str:
    wrong = next((sign for sign in name if sign.isspace() or sign in NOT_IN_IDS), None)
    if wrong is not None:
        raise ValueError(f"SUMO takes no {wrong!r} in an id")
    return name


Id = Annotated[str, Field(min_length=1), AfterValidator(_usable)]


class _Point(BaseModel):
    x: Annotated[float, Field(allow_inf_nan=False)]
    y: Annotated[float, Field(allow_inf_nan=False)]


class _Lane(BaseModel):
    width: Positive
    maxSpeed: Positive


class _Road(BaseModel):
    id: Id
    points: list[_Point] = Field(min_length=2)
    lanes: list[_Lane] = Field(min_length=1)
    startIntersection: str
    endIntersection: str

    @property
    def points_at(self) -> list[tuple[float, float]]:
        return [(point.x, point.y) for point in self.points]


class _LaneLink(BaseModel):
    startLaneIndex: int = Field(ge=0)
    endLaneIndex: int = Field(ge=0)


class _RoadLink(BaseModel):
    type: str
    startRoad: str
    endRoad: str
    laneLinks: list[_LaneLink]


class _LightPhase(BaseModel):
    time: float
    availableRoadLinks: list[int]


class _TrafficLight(BaseModel):
    lightphases: list[_LightPhase] = []


class _Intersection(BaseModel):
    id: Id
    point: _Point
    width: float = Field(default=0.0, ge=0)
    roadLinks: list[_RoadLink] = []
    trafficLight: _TrafficLight | None = None
    virtual: bool = False


class _Roadnet(BaseModel):
    intersections: list[_Intersection]
    roads: list[_Road]


_ADAPTER = TypeAdapter(_Roadnet)


def read_roadnet(path: Path, all_phases: bool = False) -> PlainNetwork:
    """A CityFlow road network.

    The light phases of a junction become its phases unless they serve only what is free in every
    phase (CityFlow's clearing phase). Without ``all_phases`` the first of them, in the file's
    order, are kept until every movement is served; on the public grids these are the paper's
    four, WT_ET, NT_ST, WL_EL, NL_SL. Raises ``UserError`` with the place of what is wrong.
    """
    roadnet = parse(_ADAPTER, read_json(path, FIELD), FIELD, path)
    for kind, ids in (
        ("road", [road.id for road in roadnet.roads]),
        ("intersection", [node.id for node in roadnet.intersections]),
    ):
        twice = [name for name, count in Counter(ids).items() if count > 1]
        if twice:
            raise UserError(FIELD, path, f"{kind} {twice[0]} is there twice")
    roads = {road.id: road for road in roadnet.roads}
    nodes = {node.id: node for node in roadnet.intersections}
    for road in roadnet.roads:
        for end in (road.startIntersection, road.endIntersection):
            if end not in nodes:
                raise UserError(FIELD, path, f"road {road.id} names unknown intersection {end}")
        if len(set(road.points_at)) == 1:
            raise UserError(FIELD, path, f"road {road.id} has no length")
    plain_nodes = {}
    for node in roadnet.intersections:
        movements = tuple(_movement(node, link, roads, path) for link in node.roadLinks)
        free, phases = _phases(node, path, all_phases)
        plain_nodes[node.id] = Node(
            id=node.id,
            x=node.point.x,
            y=node.point.y,
            movements=movements,
            phases=phases,
            free=free,
            stop_distance=node.width or None,
        )
    if not any(node.signalised for node in plain_nodes.values()):
        raise UserError(FIELD, path, "no intersection in it has signals with phases")
    return PlainNetwork(nodes=plain_nodes, roads={r.id: _road(r) for r in roadnet.roads})


def _road(road: _Road) -> Road:
    lanes = tuple(Lane(width=lane.width, speed=lane.maxSpeed) for lane in reversed(road.lanes))
    return Road(road.id, road.startIntersection, road.endIntersection, lanes, tuple(road.points_at))


def _movement(
    node: _Intersection, link: _RoadLink, roads: dict[str, _Road], path: Path
) -> Movement:
    where = f"intersection {node.id}, link {link.startRoad} to {link.endRoad}"
    if link.type not in TURN_OF_TYPE:
        raise UserError(
            FIELD, path, f"{where}: type {link.type!r}, allowed: {', '.join(TURN_OF_TYPE)}"
        )
    for road_id in (link.startRoad, link.endRoad):
        if road_id not in roads:
            raise UserError(FIELD, path, f"{where}: unknown road {road_id}")
    start, end = roads[link.startRoad], roads[link.endRoad]
    if start.endIntersection != node.id or end.startIntersection != node.id:
        raise UserError(FIELD, path, f"{where}: the two roads do not meet there")
    pairs = []
    for lane in link.laneLinks:
        if lane.startLaneIndex >= len(start.lanes) or lane.endLaneIndex >= len(end.lanes):
            raise UserError(
                FIELD,
                path,
                f"{where}: lane link {lane.startLaneIndex} to {lane.endLaneIndex}, but the roads "
                f"have {len(start.lanes)} and {len(end.lanes)} lanes",
            )
        pairs.append(
            (len(start.lanes) - 1 - lane.startLaneIndex, len(end.lanes) - 1 - lane.endLaneIndex)
        )
    if not pairs:
        raise UserError(FIELD, path, f"{where}: it has no lane links")
    return Movement(
        link.startRoad, link.endRoad, TURN_OF_TYPE[link.type], tuple(sorted(set(pairs)))
    )


def _phases(
    node: _Intersection, path: Path, all_phases: bool
) -> tuple[tuple[int, ...], tuple[Phase, ...]]:
    """The movements that are free in every phase, and the phases of a junction."""
    lights = node.trafficLight.lightphases if node.trafficLight and not node.virtual else []
    served = [frozenset(light.availableRoadLinks) for light in lights]
    for number, links in enumerate(served):
        wrong = [k for k in links if not 0 <= k < len(node.roadLinks)]
        if wrong:
            raise UserError(
                FIELD,
                path,
                f"intersection {node.id}, light phase {number}: road link {wrong[0]}, but the "
                f"intersection has {len(node.roadLinks)}",
            )
    some = [links for links in served if links]  # an all-red phase stops what is always green too
    free = frozenset.intersection(*some) if len(some) > 1 else frozenset()
    kept: list[Phase] = []
    seen: set[frozenset[int]] = set()
    covered = set(free)
    for number, links in enumerate(served):
        wanted = links - free
        if not wanted or wanted in seen or (not all_phases and wanted <= covered):
            continue
        seen.add(wanted)
        covered |= wanted
        kept.append(Phase(name=str(number), movements=tuple(sorted(wanted))))
    return tuple(sorted(free)) if kept else (), tuple(kept)
