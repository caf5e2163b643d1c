"""What a network's picture shows inside the map: roads, lanes and intersections."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize

from tsc_missing.network.coverage import Coverage
from tsc_missing.network.model import BoolArray, FloatArray, Network
from tsc_missing.network.picture_style import HATCH, INK, NEVER, ROAD, SHARES, WHITE, Sizes
from tsc_missing.network.roads import Road, band, lane_offsets, last_part

ALWAYS = 1 - 1e-9  # a mean of slots that are always missing
LANE_END = 0.26  # blocks, the length of a lane's end that shows its share


def draw_roads(axes: Axes, roads: Sequence[Road], sizes: Sizes) -> None:
    """Each direction as a band on its own side, as wide as its lanes.

    Junctions that roads stop short of are filled, so that the roads meet.
    """
    style = {"facecolor": ROAD, "edgecolor": ROAD, "linewidth": 0.4}
    gaps = {area.tobytes(): area for road in roads for area in road.gaps}
    if gaps:
        _polygons(axes, list(gaps.values()), 0.9, "junctions", style)
    _polygons(axes, [road_band(road, sizes) for road in roads], 1, "roads", style)


def road_band(road: Road, sizes: Sizes) -> FloatArray:
    """(2K, 2): the outline of the band that a road is drawn as [m]."""
    offsets, half = lane_offsets(road, sizes.lane, sizes.gap), sizes.lane / 2
    return band(road.line, offsets.min() - half, offsets.max() + half)


def _polygons(
    axes: Axes, outlines: Sequence[FloatArray], level: float, gid: str, style: dict[str, Any]
) -> None:
    polygons = PolyCollection(outlines, zorder=level, gid=gid, **style)
    axes.add_collection(polygons, autolim=False)


def draw_lanes(
    axes: Axes,
    network: Network,
    roads: Sequence[Road],
    sizes: Sizes,
    scale: float,
    coverage: Coverage,
    colours: Normalize,
) -> None:
    """The last part of each entrance lane in the colour of its share of missing readings.

    Only at intersections whose slots differ; lanes that never report are hatched. The map has
    ``scale`` points a metre.
    """
    table = lane_shares(network, coverage)
    ends = _lane_ends(network, roads, sizes, np.flatnonzero(coverage.uneven).tolist())
    seen = [lane for lane in ends if lane in table and table[lane] < ALWAYS]
    never = [lane for lane in ends if lane in table and table[lane] >= ALWAYS]
    edge: dict[str, Any] = {"edgecolor": WHITE, "linewidth": min(0.4, 0.12 * sizes.lane * scale)}
    if seen:
        shares = np.array([table[lane] for lane in seen])
        style = {**edge, "array": shares, "cmap": SHARES, "norm": colours}
        _polygons(axes, [ends[lane] for lane in seen], 2, "lanes", style)
    if never:
        style = {**edge, "facecolor": NEVER, "hatch": HATCH}
        _polygons(axes, [ends[lane] for lane in never], 2, "lanes-never-observed", style)


def _lane_ends(
    network: Network,
    roads: Sequence[Road],
    sizes: Sizes,
    chosen: Sequence[int],
) -> dict[str, FloatArray]:
    """The outlines of the last parts of the lanes that lead to the ``chosen`` intersections."""
    goal = {road: n for n in chosen for road in network.intersections[n].roads}
    half, ends = sizes.lane / 2, {}
    for road in (road for road in roads if road.id in goal):
        reach = float(sizes.radius[goal[road.id]])
        part = last_part(road.line, reach + LANE_END * sizes.block, reach)
        for lane, offset in zip(road.lanes, lane_offsets(road, sizes.lane, sizes.gap), strict=True):
            ends[lane] = band(part, offset - half, offset + half)
    return ends


def lane_shares(network: Network, coverage: Coverage) -> dict[str, float]:
    """The share of missing readings of each entrance lane: the mean over its slots."""
    lanes, flat, weight = network.lane_slots
    sums = np.bincount(lanes, weight * coverage.missing.ravel()[flat])
    return dict(zip(network.entrance_lanes, sums.tolist(), strict=True))


def draw_intersections(
    axes: Axes,
    network: Network,
    sizes: Sizes,
    scale: float,
    coverage: Coverage | None,
    colours: Normalize,
) -> None:
    """A mark for each intersection; the map has ``scale`` points a metre."""
    area = (2 * sizes.radius * scale) ** 2
    places = network.coordinates

    def mark(which: BoolArray, gid: str, shape: str, grow: float = 1.0, **style: Any) -> None:
        if which.any():
            x, y = places[which].T
            axes.scatter(x, y, s=area[which] * grow**2, marker=shape, gid=gid, zorder=3, **style)

    if coverage is None:
        mark(np.ones(network.n, bool), "intersections", "o", c=INK, linewidths=0)
        return
    seen = ~coverage.blind & ~coverage.partly
    share = coverage.intersections
    outline: dict[str, Any] = {"edgecolors": INK, "linewidths": 0.9}
    mark(seen, "always-observed", "o", c=WHITE, **outline)
    mark(
        coverage.partly,
        "partly-observed",
        "o",
        c=share[coverage.partly],
        cmap=SHARES,
        norm=colours,
        **outline,
    )
    mark(coverage.blind, "never-observed", "s", 1.15, c=NEVER, **outline)
    mark(coverage.blind, "never-observed-crosses", "x", 0.75, c=WHITE, linewidths=2.0)
