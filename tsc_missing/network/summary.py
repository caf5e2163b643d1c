"""A network in numbers, for people and for JSON."""

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from pydantic import BaseModel, ConfigDict

from tsc_missing.network.coverage import Coverage
from tsc_missing.network.model import BoolArray, Network
from tsc_missing.network.roads import Road
from tsc_missing.network.slots import slot_name


class Part(BaseModel):
    """A frozen part of a summary."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class PhaseSummary(Part):
    """A phase and the slots that it gives green to."""

    name: str
    slots: tuple[str, ...]


class SignalSummary(Part):
    """The phases of one kind of intersection, and the intersections of that kind."""

    intersections: int
    ids: tuple[str, ...]
    phases: tuple[PhaseSummary, ...]
    always_green: tuple[str, ...]


class MovementSummary(Part):
    """A movement and the lanes that its sensor covers, those at the stop line first."""

    intersection: str
    movement: str
    lanes: tuple[str, ...]  # SUMO's ids


class NetworkSummary(Part):
    """A network in numbers; ``signals`` has the most common kind of intersection first."""

    intersections: int
    entrance_lanes: int
    slots_present: int
    slots_absent: int
    roads: int  # one for each direction
    boundary_entries: int  # roads that vehicles come to from outside
    road_length: float  # [m], the sum over roads
    lane_length: float  # [m], the sum over lanes
    signals: tuple[SignalSummary, ...]
    movements: tuple[MovementSummary, ...]


class SensorSummary(Part):
    """Which sensors are missing."""

    source: str  # where the mask is from, in words
    steps: int  # decision steps of the mask
    missing_share: float  # of all readings
    never_observed: tuple[str, ...]  # ids of intersections
    partly_observed: int  # intersections
    slots_never_observed: int  # those of never observed intersections included


def summarise_network(network: Network, roads: Sequence[Road]) -> NetworkSummary:
    """The network in numbers."""
    lanes = network.record.lanes
    present = int(network.slot_mask.sum())
    return NetworkSummary(
        intersections=network.n,
        entrance_lanes=len(network.entrance_lanes),
        slots_present=present,
        slots_absent=network.slot_mask.size - present,
        roads=len(roads),
        boundary_entries=sum(road.entry for road in roads),
        road_length=round(sum(max(lanes[lane].length for lane in road.lanes) for road in roads), 1),
        lane_length=round(sum(lane.length for lane in lanes.values()), 1),
        signals=_signals(network),
        movements=tuple(_movements(network)),
    )


def _movements(network: Network) -> Iterator[MovementSummary]:
    for n, slot in np.argwhere(network.slot_mask):
        lanes = network.slot_lanes[n][slot]
        upstream = [part.lane for lane in lanes for part in network.reach.get(lane, ())]
        yield MovementSummary(
            intersection=network.ids[n],
            movement=slot_name(int(slot)),
            lanes=tuple(dict.fromkeys([*lanes, *upstream])),
        )


def _signals(network: Network) -> tuple[SignalSummary, ...]:
    """The kinds of intersections by their phases, the most common first."""
    kinds: dict[tuple[tuple[PhaseSummary, ...], tuple[str, ...]], list[str]] = {}
    for n, name in enumerate(network.ids):
        kinds.setdefault((_phases(network, n), _always_green(network, n)), []).append(name)
    return tuple(
        SignalSummary(intersections=len(ids), ids=tuple(ids), phases=phases, always_green=always)
        for (phases, always), ids in sorted(kinds.items(), key=lambda kind: -len(kind[1]))
    )


def _phases(network: Network, n: int) -> tuple[PhaseSummary, ...]:
    return tuple(
        PhaseSummary(name=phase.name, slots=_names(table))
        for phase, table in zip(network.intersections[n].phases, network.phases[n], strict=False)
    )


def _always_green(network: Network, n: int) -> tuple[str, ...]:
    return _names(network.free_slots[n])


def _names(slots: BoolArray) -> tuple[str, ...]:
    return tuple(slot_name(int(slot)) for slot in np.flatnonzero(slots))


def summarise_sensors(
    coverage: Coverage, ids: Sequence[str], source: str, steps: int
) -> SensorSummary:
    """What is missing; ``ids`` are the N intersections' ids."""
    return SensorSummary(
        source=source,
        steps=steps,
        missing_share=round(coverage.share, 6),
        never_observed=tuple(itertools.compress(ids, coverage.blind.tolist())),
        partly_observed=int(coverage.partly.sum()),
        slots_never_observed=int(coverage.never.sum()),
    )
