"""What a network's picture shows inside the map: roads, lanes, intersections and their names."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from tsc_missing.network.coverage import Coverage
from tsc_missing.network.model import BoolArray, FloatArray, Network
from tsc_missing.network.picture_style import INK, NEVER, POINTS, ROAD, SHARES, WHITE, Sizes
from tsc_missing.network.roads import Road, band, lane_offsets, last_part

SMALLEST, LARGEST = 4.5, 9.0  # [points], the size of intersections' names


def draw_roads(axes: Axes, roads: Sequence[Road], sizes: Sizes) -> None:
    """Each direction as a band on its own side, as wide as its lanes."""
    bands = []
    for road in roads:
        offsets = lane_offsets(road, sizes.lane, sizes.gap)
        half = sizes.lane / 2
        bands.append(band(road.line, offsets.min() - half, offsets.max() + half))
    axes.add_collection(
        PolyCollection(
            bands, facecolor=ROAD, edgecolor=ROAD, linewidth=0.4, zorder=1, gid="roads"
        ),
        autolim=False,
    )


def draw_lanes(
    axes: Axes,
    network: Network,
    roads: Sequence[Road],
    sizes: Sizes,
    radius: FloatArray,
    coverage: Coverage,
    scale: Normalize,
) -> None:
    """The last part of each entrance lane in the colour of its share of missing readings.

    Only at intersections whose slots differ; lanes that never report are hatched.
    """
    table = lane_shares(network, coverage)
    outlines, shares = [], []
    for n in np.flatnonzero(coverage.uneven):
        for road in (road for road in roads if road.id in network.intersections[n].roads):
            offsets = lane_offsets(road, sizes.lane, sizes.gap)
            part = last_part(road.line, radius[n] + 0.26 * sizes.block, radius[n])
            for lane, offset in zip(road.lanes, offsets, strict=True):
                if lane in table:
                    half = sizes.lane / 2
                    outlines.append(band(part, offset - half, offset + half))
                    shares.append(table[lane])
    values = np.array(shares)
    never = values >= 1
    styles = (
        (~never, "lanes", {"array": values[~never], "cmap": SHARES, "norm": scale}),
        (never, "lanes-never-observed", {"facecolor": NEVER, "hatch": "//////"}),
    )
    for chosen, gid, style in styles:
        if chosen.any():
            picked = [outlines[k] for k in np.flatnonzero(chosen)]
            axes.add_collection(
                PolyCollection(
                    picked, edgecolor=INK, linewidth=0.35, zorder=2, gid=gid, **style
                ),
                autolim=False,
            )


def lane_shares(network: Network, coverage: Coverage) -> dict[str, float]:
    """The share of missing readings of each entrance lane: the mean over its slots."""
    lanes, flat, weight = network.lane_slots
    sums = np.bincount(lanes, weight * coverage.missing.ravel()[flat])
    return dict(zip(network.entrance_lanes, sums.tolist(), strict=True))


def draw_intersections(
    axes: Axes,
    network: Network,
    radius: FloatArray,
    scale: float,
    coverage: Coverage | None,
    colours: Normalize,
) -> None:
    """A mark for each intersection; ``radius`` [m] is drawn at ``scale`` points a metre."""
    size = np.pi * 0 + (2 * radius * scale) ** 2
    places = network.coordinates

    def mark(which: BoolArray, gid: str, shape: str, grow: float = 1.0, **style: object) -> None:
        if which.any():
            x, y = places[which].T
            axes.scatter(
                x, y, s=size[which] * grow**2, marker=shape, gid=gid, zorder=3, **style
            )

    if coverage is None:
        mark(np.ones(network.n, bool), "intersections", "o", c=INK, linewidths=0)
        return
    seen = ~coverage.blind & ~coverage.partly
    share = coverage.intersections
    outline = {"edgecolors": INK, "linewidths": 0.9}
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


def draw_names(axes: Axes, names: Sequence[str], places: FloatArray, radius: FloatArray) -> int:
    """Write the names beside the marks, none over another; returns how many found no room.

    All are of one size, the largest at which they have room between the roads.
    """
    assert axes.figure is not None
    renderer = FigureCanvasAgg(axes.figure).get_renderer()
    taken: list[tuple[int, Text]] = []
    for size in np.arange(LARGEST, SMALLEST - 0.1, -0.5):
        for _, text in taken:
            text.remove()
        taken = []
        boxes: list[Bbox] = []
        for name, place, reach in zip(names, places, radius, strict=True):
            text = _place(axes, name, place, reach, float(size), boxes, renderer)
            if text is not None:
                taken.append((0, text))
        if len(taken) == len(names):
            break
    return len(names) - len(taken)
