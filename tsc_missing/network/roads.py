"""The course of a network's roads, read from its SUMO net, and polylines beside them.

A polyline is (K, 2): x and y of K points [m], in the direction of travel.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tsc_missing.network.model import FloatArray
from tsc_missing.network.records import NetworkRecord

REACHED = 1.0  # [m] from a junction's middle, within which a road's line reaches it


@dataclass(frozen=True)
class Road:
    """One direction of a road; ``lanes`` are ordered from the outermost to the innermost."""

    id: str
    line: FloatArray  # (K, 2) [m], from junction to junction
    lanes: tuple[str, ...]
    two_way: bool  # there is a road in the other direction between the same junctions
    out: int  # the side of ``line`` that the outermost lane is on: 1 = right, -1 = left
    entry: bool  # vehicles come to it from nowhere in the network
    gaps: tuple[FloatArray, ...] = ()  # (K, 2) each [m], areas of junctions that it stops short of


def read_roads(net_file: Path, record: NetworkRecord) -> tuple[Road, ...]:
    """The roads of ``record`` as they lie in a net file (plain or gzipped), sorted by id."""
    import sumolib

    net = sumolib.net.readNet(str(net_file))
    known = {lane.road for lane in record.lanes.values()}
    edges = [edge for edge in net.getEdges(withInternal=False) if edge.getID() in known]
    pairs = {(edge.getFromNode().getID(), edge.getToNode().getID()) for edge in edges}
    out = -1 if sum(_outermost_side(edge) for edge in edges) < 0 else 1
    roads = (_road(edge, record, pairs, out) for edge in edges)
    return tuple(sorted(roads, key=lambda road: road.id))


def _road(edge: Any, record: NetworkRecord, pairs: set[tuple[str, str]], out: int) -> Road:
    start, end = edge.getFromNode().getID(), edge.getToNode().getID()
    lanes = (lane.getID() for lane in edge.getLanes())
    return Road(
        id=edge.getID(),
        line=_without_repeats(edge.getRawShape()),
        lanes=tuple(lane for lane in lanes if lane in record.lanes),
        two_way=start != end and (end, start) in pairs,
        out=out,
        entry=edge.is_fringe(edge.getIncoming()),
        gaps=_gaps(edge),
    )


def _gaps(edge: Any) -> tuple[FloatArray, ...]:
    """The areas of the junctions at the road's ends whose middles its line does not reach."""
    line = edge.getRawShape()
    return tuple(
        np.array(node.getShape(), dtype=np.float64)[:, :2]
        for node, end in ((edge.getFromNode(), line[0]), (edge.getToNode(), line[-1]))
        if len(node.getShape()) > 2 and math.dist(node.getCoord()[:2], end[:2]) > REACHED
    )


def _outermost_side(edge: Any) -> int:
    """1 if the outermost lane lies to the right of the edge's line, -1 left, 0 on it."""
    line = _without_repeats(edge.getRawShape())
    (x, y), (end_x, end_y) = line[0], line[1]
    lane_x, lane_y = edge.getLanes()[0].getShape()[0][:2]
    cross = (end_x - x) * (lane_y - y) - (end_y - y) * (lane_x - x)
    return int(np.sign(-cross))


def _without_repeats(points: Sequence[tuple[float, float]]) -> FloatArray:
    """The points as a polyline without repeated ones; it keeps two points at least."""
    line: FloatArray = np.array(points, dtype=np.float64)[:, :2]
    moved = np.r_[True, np.any(np.diff(line, axis=0) != 0, axis=1)]
    kept: FloatArray = line[moved] if moved.sum() > 1 else line[[0, -1]]
    return kept


def lane_offsets(road: Road, width: float, gap: float) -> FloatArray:
    """How far right of the road's line each lane's middle is drawn [m], for lanes so wide [m].

    Two-way roads lie wholly on their own side, half of ``gap`` [m] from the line; one-way roads
    lie on the line.
    """
    count = len(road.lanes)
    inner = gap / 2 if road.two_way else -width * count / 2
    outward: FloatArray = np.arange(count - 0.5, 0, -1.0)
    offsets: FloatArray = road.out * (inner + width * outward)
    return offsets


def beside(line: FloatArray, distance: float) -> FloatArray:
    """(K, 2): the polyline ``distance`` [m] to the right of ``line``, with mitred corners."""
    steps = np.diff(line, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])[:, None]
    normals: FloatArray = np.c_[steps[:, 1], -steps[:, 0]] / np.where(lengths > 0, lengths, 1)
    corners = np.vstack([normals[:1], normals[:-1] + normals[1:], normals[-1:]])
    scale = (corners * np.vstack([normals[:1], normals])).sum(axis=1, keepdims=True)
    moved: FloatArray = line + distance * corners / np.maximum(scale, 0.25)
    return moved


def band(line: FloatArray, left: float, right: float) -> FloatArray:
    """(2K, 2): the outline of the band between two distances [m] to the right of ``line``."""
    outline: FloatArray = np.vstack([beside(line, left), beside(line, right)[::-1]])
    return outline


def last_part(line: FloatArray, start: float, end: float) -> FloatArray:
    """The part of a polyline between two distances [m] from its end, ``start`` > ``end``."""
    lengths = np.hypot(*np.diff(line, axis=0).T)
    along = np.r_[0.0, np.cumsum(lengths)]
    first, last = (float(np.clip(along[-1] - d, 0, along[-1])) for d in (start, end))
    inner = line[(along > first) & (along < last)]
    cuts = [[np.interp(at, along, line[:, axis]) for axis in (0, 1)] for at in (first, last)]
    part: FloatArray = np.vstack([cuts[:1], inner, cuts[1:]])
    return part
