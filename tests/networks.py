"""Grids as ``Network``s in pure Python, shaped as ``network.compile`` shapes them from SUMO nets.

Intersection ``n_r_c`` is in row r (1 is the southernmost) and column c (1 is the westernmost);
rows and columns 0 and last + 1 are boundary nodes. Road ``r_{from}_{to}`` has three lanes: 0 turns
right, 1 goes straight, 2 turns left. Every lane is linked to all lanes of the exit road.
"""

from collections.abc import Collection, Iterator

import numpy as np

from tsc_missing.controllers.base import ControlContext
from tsc_missing.network.model import Network
from tsc_missing.network.records import (
    IntersectionRecord,
    LaneRecord,
    LinkRecord,
    NetworkRecord,
    PhaseRecord,
)
from tsc_missing.network.slots import (
    APPROACHES,
    LEFT,
    N_SLOTS,
    RIGHT,
    RIGHT_OF_WAY,
    STRAIGHT,
    TURNS,
    slot_index,
)

Cell = tuple[int, int]

N, E, S, W = range(4)
SIDES = {N: (1, 0), E: (0, 1), S: (-1, 0), W: (0, -1)}  # step in (row, column) to that side
LANE = {RIGHT: 0, STRAIGHT: 1, LEFT: 2}
SPACING = (800.0, 400.0)  # [m] between rows, between columns
ROAD_LENGTH, SPEED = 385.0, 11.111
PHASES = {
    "WT_ET": (slot_index(W, STRAIGHT), slot_index(E, STRAIGHT)),
    "NT_ST": (slot_index(N, STRAIGHT), slot_index(S, STRAIGHT)),
    "WL_EL": (slot_index(W, LEFT), slot_index(E, LEFT)),
    "NL_SL": (slot_index(N, LEFT), slot_index(S, LEFT)),
}


def grid_network(
    rows: int, columns: int, name: str = "grid", closed: Collection[tuple[int, int, int]] = ()
) -> Network:
    """A grid of four-armed intersections with boundary roads on all its sides.

    ``closed`` names boundary roads, as (row, column, side of that intersection), to leave out.
    """
    cells = [(row, column) for row in range(1, rows + 1) for column in range(1, columns + 1)]
    arms = {
        cell: {side: neighbour(cell, side) for side in range(4) if (*cell, side) not in set(closed)}
        for cell in cells
    }
    record = NetworkRecord(
        intersections=tuple(_intersection(cell, arms[cell]) for cell in cells),
        lanes={
            f"{road}_{lane}": LaneRecord(road=road, length=ROAD_LENGTH, speed=SPEED)
            for road in sorted(_roads(arms))
            for lane in range(len(TURNS))
        },
        upstream={road: _feeders(arms, road) for road in sorted(_roads(arms))},
    )
    return Network(name, record)


def sharing_lanes(network: Network) -> Network:
    """The same grid with right turns and straight traffic on one lane."""

    def shared(node: IntersectionRecord) -> IntersectionRecord:
        links = [
            link.model_copy(update={"from_lane": link.from_lane.removesuffix("_0") + "_1"})
            if link.from_lane.endswith("_0")
            else link
            for link in node.links
        ]
        return node.model_copy(update={"links": tuple(links)})

    nodes = tuple(map(shared, network.intersections))
    return Network(network.name, network.record.model_copy(update={"intersections": nodes}))


def tee_network(name: str = "tee") -> Network:
    """A 2 x 3 grid whose intersection ``n_2_2`` is a T-junction: no road on its north side."""
    return grid_network(2, 3, name, closed=[(2, 2, N)])


def context_for(network: Network, seed: int = 0) -> ControlContext:
    """The context of a run where every slot has a sensor and wants 100 vehicles/h."""
    shape = (network.n, N_SLOTS)
    return ControlContext(
        network=network,
        turning_flows=np.where(network.slot_mask, 100.0, 0.0),
        sensors=np.ones(shape, dtype=bool),
        decision_interval=15.0,
        lost_time=5.0,
        min_steps=np.ones(network.n, dtype=np.int64),
        seed=seed,
    )


def neighbour(cell: Cell, side: int) -> Cell:
    """The cell on that side."""
    step = SIDES[side]
    return cell[0] + step[0], cell[1] + step[1]


def node_id(cell: Cell) -> str:
    """For example ``n_1_2``."""
    return f"n_{cell[0]}_{cell[1]}"


def road_id(start: Cell, end: Cell) -> str:
    """For example ``r_n_1_2_n_1_3``."""
    return f"r_{node_id(start)}_{node_id(end)}"


def leaves_to(slot: int) -> int:
    """The side on which a slot's movement leaves the intersection."""
    approach, turn = divmod(slot, len(TURNS))
    return (approach + {LEFT: 1, STRAIGHT: 2, RIGHT: 3}[turn]) % len(APPROACHES)


def _slots(arms: dict[int, Cell]) -> Iterator[int]:
    """The slots of an intersection with these arms, in the order of SUMO's links."""
    for approach in arms:
        for turn in (RIGHT, STRAIGHT, LEFT):
            slot = slot_index(approach, turn)
            if leaves_to(slot) in arms:
                yield slot


def _intersection(cell: Cell, arms: dict[int, Cell]) -> IntersectionRecord:
    entrances = {side: road_id(other, cell) for side, other in arms.items()}
    links = [
        LinkRecord(
            from_lane=f"{entrances[slot // len(TURNS)]}_{LANE[slot % len(TURNS)]}",
            to_lane=f"{road_id(cell, arms[leaves_to(slot)])}_{lane}",
            slot=slot,
        )
        for slot in _slots(arms)
        for lane in range(len(TURNS))
    ]
    everything = range(len(links))
    slots = [link.slot for link in links]
    foes = tuple(tuple(j for j in everything if _conflict(slots[i], slots[j])) for i in everything)
    rank = [RIGHT_OF_WAY[slot % len(TURNS)] for slot in slots]
    phases = [
        PhaseRecord(name=name, links=tuple(i for i in everything if slots[i] in served))
        for name, served in PHASES.items()
    ]
    return IntersectionRecord(
        id=node_id(cell),
        x=cell[1] * SPACING[1],
        y=cell[0] * SPACING[0],
        roads={road: side for side, road in entrances.items()},
        links=tuple(links),
        foes=foes,
        yields=tuple(tuple(j for j in foes[i] if rank[j] < rank[i]) for i in everything),
        phases=tuple(phase for phase in phases if phase.links),
        free=tuple(i for i in everything if slots[i] % len(TURNS) == RIGHT),
    )


def _conflict(first: int, second: int) -> bool:
    """Whether two movements from different arms cross or end on the same road.

    Clockwise around the junction an arm has its entrance and then its exit; two movements cross
    where their ends alternate on that circle.
    """
    if first // len(TURNS) == second // len(TURNS):
        return False
    ends = [(2 * (slot // len(TURNS)), 2 * leaves_to(slot) + 1) for slot in (first, second)]
    low, high = sorted(ends[0])
    crosses = (low < ends[1][0] < high) != (low < ends[1][1] < high)
    return ends[0][1] == ends[1][1] or crosses


def _roads(arms: dict[Cell, dict[int, Cell]]) -> dict[str, tuple[Cell, Cell]]:
    return {
        road_id(*ends): ends
        for cell, others in arms.items()
        for other in others.values()
        for ends in ((cell, other), (other, cell))
    }


def _feeders(arms: dict[Cell, dict[int, Cell]], road: str) -> tuple[tuple[str, int], ...]:
    start, end = _roads(arms)[road]
    if start not in arms:
        return ()
    return tuple(
        (node_id(start), slot)
        for slot in sorted(_slots(arms[start]))
        if arms[start][leaves_to(slot)] == end
    )
