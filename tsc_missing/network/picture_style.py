"""The sizes, colours and marks of a network's picture.

The marks differ in shape and in lightness too, so that they are told apart without colours:
always observed is a white circle, partly observed a circle from light to dark, and never observed
a dark-edged square with a cross.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tsc_missing.network.coverage import Coverage
from tsc_missing.network.model import FloatArray, IntArray, Network
from tsc_missing.network.roads import Road

INK = "#1f2933"
QUIET = "#52606d"
ROAD = "#d3d8dd"
WHITE = "#ffffff"
NEVER = "#d55e00"
SHARES = "YlGnBu"  # from light to dark

HATCH = "//////"  # of lanes that never report

POINTS = 72.0  # an inch
THINNEST = 8.0  # the map is at most so many times as long as wide
MARK_ROOM = 1.3  # radii around an intersection that its mark may take


@dataclass(frozen=True)
class Sizes:
    """How large things are drawn, in metres of the network: larger than they are, to be seen."""

    lane: float  # width of a lane
    gap: float  # between the directions of a road
    block: float  # a typical distance between intersections
    radius: FloatArray  # (N,), of the intersections' marks
    bounds: tuple[float, float, float, float]  # left, bottom, right, top of the whole drawing

    @property
    def width(self) -> float:
        """The drawing's width [m]."""
        return self.bounds[2] - self.bounds[0]

    @property
    def height(self) -> float:
        """The drawing's height [m]."""
        return self.bounds[3] - self.bounds[1]


def choose_sizes(network: Network, roads: Sequence[Road]) -> Sizes:
    """Sizes in proportion to the distances between the network's intersections."""
    points = np.vstack([road.line for road in roads])
    block = _block(network.coordinates, float(np.ptp(points, axis=0).max()))
    most = max(len(road.lanes) for road in roads)
    lane = min(0.03 * block, 0.13 * block / most)
    gap = 0.8 * lane
    reach = 1.15 * (_most_lanes(network, roads) * lane + gap / 2)
    radius: FloatArray = np.maximum(reach, 0.13 * block)
    around = np.repeat(network.coordinates, 2, axis=0)
    around += MARK_ROOM * np.outer(np.column_stack([-radius, radius]).ravel(), [1, 1])
    margin = 1.2 * lane * most
    return Sizes(lane, gap, block, radius, _bounds(points, margin, around))


def _block(places: FloatArray, extent: float) -> float:
    """The median distance of an intersection to its nearest [m]; a part of ``extent`` for one."""
    if len(places) == 1:
        return 0.5 * extent
    apart = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    np.fill_diagonal(apart, np.inf)
    return float(np.median(apart.min(axis=1)))


def _most_lanes(network: Network, roads: Sequence[Road]) -> IntArray:
    """(N,): the lanes of the widest road that comes to each intersection."""
    lanes = {road.id: len(road.lanes) for road in roads}
    return np.array([max(lanes[road] for road in node.roads) for node in network.intersections])


def _bounds(
    points: FloatArray, margin: float, around: FloatArray
) -> tuple[float, float, float, float]:
    """Left, bottom, right, top [m] around points with a margin and others without one."""
    low = np.minimum(points.min(axis=0) - margin, around.min(axis=0))
    high = np.maximum(points.max(axis=0) + margin, around.max(axis=0))
    size = np.maximum(high - low, (high - low).max() / THINNEST)
    left, bottom = ((low + high - size) / 2).tolist()
    width, height = size.tolist()
    return left, bottom, left + width, bottom + height


def top_share(coverage: Coverage) -> float:
    """The upper end of the colour scale: the largest share of a partly observed place, rounded."""
    shares = np.r_[coverage.missing[coverage.partly].ravel(), coverage.intersections]
    partial = shares[shares < 1]
    return max(0.1, float(np.ceil(10 * partial.max(initial=0.0) - 1e-9)) / 10)
