"""A road network in plain terms, on its way to SUMO: nodes, roads, links and signal phases.

CityFlow files and grid specifications are both read into these classes, and one writer turns
them into a SUMO net with ``netconvert``.
"""

from dataclasses import dataclass, field

from tsc_missing.network.slots import bearing

Point = tuple[float, float]  # x, y [m]; x to the east, y to the north


@dataclass(frozen=True)
class Lane:
    """A lane: width [m] and speed limit [m/s]."""

    width: float
    speed: float


@dataclass(frozen=True)
class Road:
    """A one-way road. ``lanes[0]`` is the rightmost, as in SUMO; ``shape`` runs node to node."""

    id: str
    start: str
    end: str
    lanes: tuple[Lane, ...]
    shape: tuple[Point, ...]


@dataclass(frozen=True)
class Movement:
    """A turn (``slots.LEFT`` and so on) between two roads over (from lane, to lane) pairs."""

    from_road: str
    to_road: str
    turn: int
    lane_pairs: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Phase:
    """A named set of movements, given by their positions in ``Node.movements``."""

    name: str
    movements: tuple[int, ...]


@dataclass(frozen=True)
class Node:
    """A junction, without signals if it has no phases."""

    id: str
    x: float
    y: float
    movements: tuple[Movement, ...] = ()
    phases: tuple[Phase, ...] = ()
    free: tuple[int, ...] = ()  # movements that are green in every phase
    stop_distance: float | None = None  # [m] centre to stop line; None: netconvert's

    @property
    def signalised(self) -> bool:
        """Whether the junction has signals."""
        return bool(self.phases)


@dataclass(frozen=True)
class PlainNetwork:
    """Nodes and roads by id."""

    nodes: dict[str, Node] = field(default_factory=dict)
    roads: dict[str, Road] = field(default_factory=dict)

    def comes_from(self, node: Node, road: str) -> float:
        """The compass bearing [degrees] that a road's traffic comes from at its end, a node."""
        x, y = self.roads[road].shape[-2]
        return bearing(x - node.x, y - node.y)
