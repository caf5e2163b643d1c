"""What ``network.json`` holds: the signalised intersections of a SUMO network, as plain records.

It is compiled once from the net (``network.compile``) so that a run reads no XML; a test holds it
against the net.
"""

from pathlib import Path
from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

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

    ``positions[i]`` is link i's place in SUMO's state string of ``state_length`` letters, where
    they are not the links' own order: several links may share a place (a signal group), and
    places without a link (pedestrian crossings) stay red. ``yellow`` and ``min_green`` [s] are the
    intersection's own, where it has them.
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
    positions: tuple[int, ...] | None = None
    state_length: int | None = None
    yellow: int | None = Field(None, gt=0)
    min_green: int | None = Field(None, ge=0)

    @model_validator(mode="after")
    def _is_of_its_links(self) -> Self:
        count = len(self.links)
        if len(self.foes) != count or len(self.yields) != count:
            raise ValueError(f"foes and yields must be lists for each of the {count} links")
        named = [*self.foes, *self.yields, self.free, *(phase.links for phase in self.phases)]
        if not all(0 <= link < count for links in named for link in links):
            raise ValueError(f"foes, yields, phases and free must name links, 0 to {count - 1}")
        if self.positions is not None:
            length = self.state_length or 0
            if len(self.positions) != count or not all(0 <= k < length for k in self.positions):
                raise ValueError(f"positions must be a place below {length} for each link")
        return self


class ReachRecord(Record):
    """A lane upstream of a short entrance lane, which the entrance lane's sensor covers too.

    ``distance`` [m] is from its end to the stop line; ``share`` is the part of its vehicles that
    count for the entrance lane.
    """

    lane: str
    distance: float
    share: float


class LaneRecord(Record):
    """A lane of the network: its road, length [m] and speed limit [m/s].

    ``no_cars`` is true where buses or lorries may drive and cars may not, ``aside`` where neither
    may: for trams, bicycles and the like. Such a lane is only here because a signal link uses it.
    """

    road: str
    length: float
    speed: float
    no_cars: bool | None = None
    aside: bool | None = None


class NetworkRecord(Record):
    """The whole of ``network.json``.

    ``upstream[road]`` are the signalised (intersection id, slot) pairs whose movements feed the
    road, found by following connections back through junctions without signals. ``reach`` lists
    for entrance lanes that are short the lanes upstream that their sensors cover too.
    """

    format: int = FORMAT
    intersections: tuple[IntersectionRecord, ...]
    lanes: dict[str, LaneRecord]
    upstream: dict[str, tuple[tuple[str, int], ...]]
    reach: dict[str, tuple[ReachRecord, ...]] | None = None
    left_hand: bool | None = None


def write_record(record: NetworkRecord, target: Path) -> None:
    """Write ``network.json``; what a network does not need is left out of it."""
    target.write_text(record.model_dump_json(exclude_none=True) + "\n", encoding="utf-8")
