"""What ``network.json`` holds: the signalised intersections of a SUMO network, as plain records.

It is compiled once from the net (``network.compile``) so that a run reads no XML; a test holds it
against the net.
"""

from pydantic import BaseModel, ConfigDict, Field

from tsc_missing.network.slots import N_SLOTS

FORMAT = 1


class Record(BaseModel):
    """A frozen record that refuses unknown fields."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class LinkRecord(Record):
    """One signal link: a connection from an entrance lane to an exit lane."""

    from_lane: str
    to_lane: str
    slot: int = Field(ge=0, lt=N_SLOTS)


class PhaseRecord(Record):
    """Links (indices into the intersection's links) that may be green together."""

    name: str
    links: tuple[int, ...]


class IntersectionRecord(Record):
    """A signalised intersection; ``id`` is also the id of its traffic light in SUMO.

    ``links[i]`` is the link at position i of SUMO's state string. ``foes[i]`` and ``yields[i]``
    list the links that link i conflicts with, and those of them it must give way to when both
    are green. ``free`` are the links that are green in every phase (right turns on the grids).
    ``roads`` maps each incoming road to its approach.
    """

    id: str
    x: float
    y: float
    roads: dict[str, int]
    links: tuple[LinkRecord, ...]
    foes: tuple[tuple[int, ...], ...]
    yields: tuple[tuple[int, ...], ...]
    phases: tuple[PhaseRecord, ...]
    free: tuple[int, ...]


class LaneRecord(Record):
    """A lane of the network: its road, length [m] and speed limit [m/s]."""

    road: str
    length: float
    speed: float


class NetworkRecord(Record):
    """The whole of ``network.json``.

    ``upstream[road]`` are the signalised (intersection id, slot) pairs whose movements feed the
    road, found by following connections back through junctions without signals.
    """

    format: int = FORMAT
    intersections: tuple[IntersectionRecord, ...]
    lanes: dict[str, LaneRecord]
    upstream: dict[str, tuple[tuple[str, int], ...]]
