"""CityFlow files for tests: small grids and a T-junction network with a shared lane."""

import json
from pathlib import Path
from typing import Any

STEPS = {0: (1, 0), 1: (0, 1), 2: (-1, 0), 3: (0, -1)}  # CityFlow's directions: E, N, W, S
TYPES = {0: "go_straight", 1: "turn_left", 3: "turn_right"}  # by change of direction
LANE_OF = {"turn_left": 0, "go_straight": 1, "turn_right": 2}
CAR = {
    "length": 5.0,
    "width": 2.0,
    "maxPosAcc": 2.0,
    "maxNegAcc": 4.5,
    "usualPosAcc": 2.0,
    "usualNegAcc": 4.5,
    "minGap": 2.5,
    "maxSpeed": 11.111,
    "headwayTime": 2,
}


def road(x: int, y: int, direction: int) -> str:
    return f"road_{x}_{y}_{direction}"


def grid_roadnet(rows: int, columns: int, spacing: tuple[float, float] = (300, 200)) -> Any:
    """A grid with boundary nodes; column x and row y count from 1, as in the public files."""
    inside = {(x, y) for x in range(1, columns + 1) for y in range(1, rows + 1)}
    nodes = inside | {
        (x + dx, y + dy) for x, y in inside for dx, dy in STEPS.values() if (x, y) in inside
    }
    ends = {
        (x, y, d): (x + dx, y + dy)
        for x, y in nodes
        for d, (dx, dy) in STEPS.items()
        if (x + dx, y + dy) in nodes and ({(x, y), (x + dx, y + dy)} & inside)
    }
    place = {(x, y): {"x": x * spacing[0], "y": y * spacing[1]} for x, y in nodes}
    roads = [
        {
            "id": road(*key),
            "points": [place[key[:2]], place[end]],
            "lanes": [{"width": 4, "maxSpeed": 11.111}] * 3,
            "startIntersection": f"intersection_{key[0]}_{key[1]}",
            "endIntersection": f"intersection_{end[0]}_{end[1]}",
        }
        for key, end in ends.items()
    ]
    return {
        "intersections": [
            _intersection(x, y, (x, y) in inside, ends, place) for x, y in sorted(nodes)
        ],
        "roads": roads,
    }


def _intersection(x: int, y: int, signalised: bool, ends: Any, place: Any) -> Any:
    links = []
    if signalised:
        for (sx, sy, direction), end in sorted(ends.items()):
            if end != (x, y):
                continue
            for change, kind in TYPES.items():
                target = (x, y, (direction + change) % 4)
                if target in ends:
                    links.append(
                        {
                            "type": kind,
                            "startRoad": road(sx, sy, direction),
                            "endRoad": road(*target),
                            "laneLinks": [
                                {"startLaneIndex": LANE_OF[kind], "endLaneIndex": lane}
                                for lane in range(3)
                            ],
                        }
                    )
    return {
        "id": f"intersection_{x}_{y}",
        "point": place[x, y],
        "width": 15 if signalised else 0,
        "roads": [],
        "roadLinks": links,
        "trafficLight": {"lightphases": _phases(links)},
        "virtual": not signalised,
    }


def _phases(links: Any) -> Any:
    free = [k for k, link in enumerate(links) if link["type"] == "turn_right"]

    def serving(kind: str, directions: tuple[int, ...]) -> list[int]:
        return [
            k
            for k, link in enumerate(links)
            if link["type"] == kind and int(link["startRoad"][-1]) in directions
        ]

    groups = [
        serving(kind, directions)
        for kind in ("go_straight", "turn_left")
        for directions in ((0, 2), (1, 3))
    ]
    phases = [free] + [sorted(free + group) for group in groups if group]
    return [{"time": 30, "availableRoadLinks": phase} for phase in phases] if links else []


def tee_roadnet() -> Any:
    """One T-junction: from west and east two lanes, from south one lane shared by both turns."""
    net = grid_roadnet(1, 1)
    keep = [r for r in net["roads"] if "1_2" not in r["startIntersection"] + r["endIntersection"]]
    for item in keep:
        item["lanes"] = item["lanes"][: 1 if item["id"] == road(1, 0, 1) else 2]
    names = {item["id"] for item in keep}
    net["roads"] = keep
    net["intersections"] = [i for i in net["intersections"] if i["id"] != "intersection_1_2"]
    node = next(i for i in net["intersections"] if not i["virtual"])
    links = [k for k in node["roadLinks"] if {k["startRoad"], k["endRoad"]} <= names]
    for link in links:
        lane = 0 if link["startRoad"] == road(1, 0, 1) else min(LANE_OF[link["type"]], 1)
        link["laneLinks"] = [{"startLaneIndex": lane, "endLaneIndex": k} for k in range(2)]
    node["roadLinks"] = links
    west, east, south = road(0, 1, 0), road(2, 1, 2), road(1, 0, 1)
    served = (
        [(west, "go_straight"), (west, "turn_right"), (east, "go_straight")],
        [(east, "go_straight"), (east, "turn_left")],
        [(south, "turn_left"), (south, "turn_right")],
    )
    node["trafficLight"]["lightphases"] = [
        {
            "time": 30,
            "availableRoadLinks": [
                k for k, link in enumerate(links) if (link["startRoad"], link["type"]) in group
            ],
        }
        for group in served
    ]
    return net


def flow(route: list[str], start: int, end: int | None = None, interval: float = 1.0) -> Any:
    return {
        "vehicle": CAR,
        "route": route,
        "interval": interval,
        "startTime": start,
        "endTime": start if end is None else end,
    }


def grid_flows(rows: int, columns: int, horizon: int = 600, interval: float = 8.0) -> Any:
    """Vehicles straight through every row and column, and one left-turning stream."""
    flows = []
    for y in range(1, rows + 1):
        flows.append([road(x, y, 0) for x in range(columns + 1)])
        flows.append([road(x, y, 2) for x in range(columns + 1, 0, -1)])
    for x in range(1, columns + 1):
        flows.append([road(x, y, 1) for y in range(rows + 1)])
        flows.append([road(x, y, 3) for y in range(rows + 1, 0, -1)])
    flows.append([road(0, 1, 0), *[road(1, y, 1) for y in range(1, rows + 1)]])
    return [flow(route, k, horizon - 1, interval) for k, route in enumerate(flows)]


def write(folder: Path, roadnet: Any, flows: Any) -> tuple[Path, Path]:
    """Write both files; returns their paths."""
    paths = folder / "roadnet.json", folder / "flow.json"
    for path, content in zip(paths, (roadnet, flows), strict=True):
        path.write_text(json.dumps(content), encoding="utf-8")
    return paths
