"""A network as arrays over intersections and movement slots: all that is downstream works on it.

N intersections, L = 12 slots (``network.slots``), P phases (the most of any intersection).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from tsc_missing.network.records import IntersectionRecord, NetworkRecord, ReachRecord
from tsc_missing.network.slots import MAX_NEIGHBOURS, N_SLOTS

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Network:
    """The signalised intersections of a network and how their slots connect.

    Everything is derived from ``record``; index n is the position in ``record.intersections``.
    A *flat slot* is ``n * 12 + slot``; -1 stands for none.
    """

    name: str
    record: NetworkRecord

    @property
    def intersections(self) -> tuple[IntersectionRecord, ...]:
        """The records of the N intersections."""
        return self.record.intersections

    @property
    def n(self) -> int:
        """The number N of intersections."""
        return len(self.record.intersections)

    @cached_property
    def ids(self) -> tuple[str, ...]:
        """The intersections' ids, which are SUMO's traffic light ids."""
        return tuple(intersection.id for intersection in self.intersections)

    @cached_property
    def slot_lanes(self) -> tuple[tuple[tuple[str, ...], ...], ...]:
        """The entrance lanes of each slot: ``slot_lanes[n][slot]``, rightmost first."""
        return tuple(
            tuple(
                tuple(sorted({link.from_lane for link in node.links if link.slot == slot}))
                for slot in range(N_SLOTS)
            )
            for node in self.intersections
        )

    @cached_property
    def slot_mask(self) -> BoolArray:
        """(N, 12): whether the slot is there."""
        return np.array([[bool(lanes) for lanes in slots] for slots in self.slot_lanes])

    @cached_property
    def slot_lane_count(self) -> IntArray:
        """(N, 12): the number of entrance lanes of each slot."""
        return np.array([[len(lanes) for lanes in slots] for slots in self.slot_lanes])

    @cached_property
    def entrance_lanes(self) -> tuple[str, ...]:
        """All entrance lanes, each once, in the order of intersections and slots."""
        return tuple(
            dict.fromkeys(lane for slots in self.slot_lanes for lanes in slots for lane in lanes)
        )

    @cached_property
    def lane_slots(self) -> tuple[IntArray, IntArray, FloatArray]:
        """Sparse lane-to-slot table: (lane position, flat slot, weight).

        A lane that several slots share counts for each with an equal part, so that the sum over
        slots is the sum over lanes.
        """
        position = {lane: k for k, lane in enumerate(self.entrance_lanes)}
        pairs = [
            (position[lane], n * N_SLOTS + slot)
            for n, slots in enumerate(self.slot_lanes)
            for slot, lanes in enumerate(slots)
            for lane in lanes
        ]
        lanes, flat = (np.array(column, dtype=np.int64) for column in zip(*pairs, strict=True))
        return lanes, flat, 1.0 / np.bincount(lanes)[lanes]

    @cached_property
    def lane_parts(self) -> FloatArray:
        """(N, 12): the entrance lanes of each slot, those that it shares in equal parts."""
        _, flat, weight = self.lane_slots
        parts = np.bincount(flat, weight, minlength=self.n * N_SLOTS)
        return np.asarray(parts.reshape(self.n, N_SLOTS))

    @cached_property
    def shares_lanes(self) -> BoolArray:
        """(N, 12): whether a slot shares an entrance lane with another."""
        _, flat, weight = self.lane_slots
        shared = np.bincount(flat, weight < 1, minlength=self.n * N_SLOTS) > 0
        return np.asarray(shared.reshape(self.n, N_SLOTS))

    @cached_property
    def slots_in_common(self) -> IntArray:
        """(N, 12): the first of the slots that a slot shares sensors with, often itself.

        Sensors are of lanes, so slots with a lane in common, upstream of short ones too, report or
        are silent together: a shared lane counts for each of them in parts, and one would tell of
        the other.
        """
        lanes, flat, _ = self.sensor_slots
        first = np.arange(self.n * N_SLOTS)
        for lane in range(len(self.sensor_lanes)):
            joined = np.isin(first, first[flat[lanes == lane]])
            if joined.any():
                first[joined] = first[joined].min()
        return first.reshape(self.n, N_SLOTS) % N_SLOTS

    @cached_property
    def reach(self) -> dict[str, tuple[ReachRecord, ...]]:
        """For short entrance lanes the lanes upstream that their sensors cover.

        A lane has a sensor for one intersection only, the one with the nearest stop line: else
        what one does not see another would tell.
        """
        reach = self.record.reach or {}
        lanes, flat, _ = self.lane_slots
        at = {
            self.entrance_lanes[k]: int(slot) // N_SLOTS
            for k, slot in zip(lanes, flat, strict=True)
        }
        nearest: dict[str, tuple[float, int]] = {}
        for lane in self.entrance_lanes:
            for part in reach.get(lane, ()):
                found = (part.distance, at[lane])
                nearest[part.lane] = min(found, nearest.get(part.lane, found))
        kept = {
            lane: tuple(part for part in reach[lane] if nearest[part.lane][1] == at[lane])
            for lane in self.entrance_lanes
            if lane in reach
        }
        return {lane: parts for lane, parts in kept.items() if parts}

    @cached_property
    def sensor_lanes(self) -> tuple[str, ...]:
        """The lanes that sensors cover: the entrance lanes, then those upstream of short ones."""
        upstream = (part.lane for parts in self.reach.values() for part in parts)
        return tuple(dict.fromkeys((*self.entrance_lanes, *upstream)))

    @cached_property
    def sensor_slots(self) -> tuple[IntArray, IntArray, FloatArray]:
        """As ``lane_slots``, with positions in ``sensor_lanes``."""
        lanes, flat, weight = self.lane_slots
        position = {lane: k for k, lane in enumerate(self.sensor_lanes)}
        more = [
            (position[part.lane], slot, part.share * part_of)
            for lane, slot, part_of in zip(lanes, flat, weight, strict=True)
            for part in self.reach.get(self.entrance_lanes[lane], ())
        ]
        if not more:
            return lanes, flat, weight
        places, slots, weights = (np.array(column) for column in zip(*more, strict=True))
        return np.r_[lanes, places], np.r_[flat, slots], np.r_[weight, weights]

    @cached_property
    def phase_mask(self) -> BoolArray:
        """(N, P): whether the intersection has the phase."""
        most = max(len(node.phases) for node in self.intersections)
        return np.array([np.arange(most) < len(node.phases) for node in self.intersections])

    @cached_property
    def phases(self) -> BoolArray:
        """(N, P, 12): whether the phase gives green to a slot; free slots are in none."""
        table = np.zeros((*self.phase_mask.shape, N_SLOTS), dtype=bool)
        for n, node in enumerate(self.intersections):
            for p, phase in enumerate(node.phases):
                table[n, p, [node.links[k].slot for k in phase.links]] = True
        return table & ~self.free_slots[:, None, :]

    @cached_property
    def free_slots(self) -> BoolArray:
        """(N, 12): slots whose every link is green in every phase (right turns on the grids)."""
        return np.array(
            [
                _slots(node, node.free) & ~_slots(node, set(range(len(node.links))) - {*node.free})
                for node in self.intersections
            ]
        )

    def first_red_steps(self) -> IntArray:
        """(N, 12): decision steps since a slot had green, before any: 0 of free slots, else 1."""
        return np.where(self.free_slots, 0, 1).astype(np.int64)

    def next_red_steps(self, red_steps: IntArray, phases: IntArray) -> IntArray:
        """(N, 12): those at the end of a step in which ``phases`` (N,) ran."""
        green = self.phases[np.arange(self.n), phases] | self.free_slots
        return np.where(green, 0, red_steps + 1)

    @cached_property
    def neighbours(self) -> IntArray:
        """(N, 12, 3): flat upstream slots whose movements feed the slot's road, -1 for none."""
        index = {name: n for n, name in enumerate(self.ids)}
        upstream = {
            road: [index[name] * N_SLOTS + slot for name, slot in feeders]
            for road, feeders in self.record.upstream.items()
        }
        lanes = self.record.lanes
        rows = [
            dict.fromkeys(k for road in roads for k in upstream.get(road, []))
            for slots in self.slot_lanes
            for roads in (sorted({lanes[lane].road for lane in slot}) for slot in slots)
        ]
        return _table([[*row] for row in rows], MAX_NEIGHBOURS).reshape(
            self.n, N_SLOTS, MAX_NEIGHBOURS
        )

    @cached_property
    def exit_lanes(self) -> tuple[tuple[tuple[str, ...], ...], ...]:
        """For each slot all lanes of the roads that its movement leads to."""
        roads: dict[str, list[str]] = {}
        for name, lane in self.record.lanes.items():
            if not lane.aside:
                roads.setdefault(lane.road, []).append(name)
        return tuple(
            tuple(
                tuple(
                    lane
                    for road in sorted(
                        {
                            self.record.lanes[link.to_lane].road
                            for link in node.links
                            if link.slot == slot
                        }
                    )
                    for lane in sorted(roads.get(road, []))
                )
                for slot in range(N_SLOTS)
            )
            for node in self.intersections
        )

    @cached_property
    def exit_lane_count(self) -> IntArray:
        """(N, 12): the number of lanes of the roads that a slot's movement leads to."""
        return np.array([[len(lanes) for lanes in slots] for slots in self.exit_lanes])

    @cached_property
    def downstream(self) -> IntArray:
        """(N, 12, D): flat slots on the roads that a slot's movement leads to, -1 for none."""
        flat: dict[str, list[int]] = {}
        for lane, slot in zip(*self.lane_slots[:2], strict=True):
            flat.setdefault(self.entrance_lanes[lane], []).append(int(slot))
        rows = [
            sorted({slot for lane in lanes for slot in flat.get(lane, [])})
            for slots in self.exit_lanes
            for lanes in slots
        ]
        return _table(rows, max(map(len, rows))).reshape(self.n, N_SLOTS, -1)

    @cached_property
    def boundary_lanes(self) -> tuple[tuple[str, ...], ...]:
        """For each intersection the exit lanes that end at no signal: it counts on them itself.

        Of a road that a plain junction cuts the first part is one. The next signal's sensors may
        cover it too, where the last part is short: they are others than these.
        """
        entrances = set(self.entrance_lanes)
        return tuple(
            tuple(sorted({lane for lanes in slots for lane in lanes} - entrances))
            for slots in self.exit_lanes
        )

    @cached_property
    def adjacency(self) -> BoolArray:
        """(N, N), symmetric: whether a road leads from one intersection to the other."""
        table = np.zeros((self.n, self.n), dtype=bool)
        index = {name: n for n, name in enumerate(self.ids)}
        for n, node in enumerate(self.intersections):
            for road in node.roads:
                feeders = self.record.upstream.get(road, ())
                table[n, [index[name] for name, _ in feeders]] = True
        table |= table.T
        np.fill_diagonal(table, False)
        return table

    @cached_property
    def coordinates(self) -> FloatArray:
        """(N, 2): x and y of each intersection [m]."""
        return np.array([[node.x, node.y] for node in self.intersections])


def _slots(node: IntersectionRecord, links: Iterable[int]) -> BoolArray:
    table = np.zeros(N_SLOTS, dtype=bool)
    table[[node.links[k].slot for k in links]] = True
    return table


def _table(rows: Sequence[Sequence[int]], width: int) -> IntArray:
    """Rows cut or padded with -1 to ``width``."""
    return np.array([[*row[:width], *[-1] * (width - len(row))] for row in rows], dtype=np.int64)
