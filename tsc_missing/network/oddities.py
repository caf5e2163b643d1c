"""What is odd about the signals of a network that was imported as its file has it."""

from collections.abc import Iterator

from tsc_missing.network.records import IntersectionRecord, NetworkRecord
from tsc_missing.network.slots import APPROACHES, slot_name

SHOWN = 5  # at most, of each kind


def oddities(record: NetworkRecord) -> Iterator[str]:
    """Notes in words, one of each kind."""
    nodes = record.intersections
    many = [node.id for node in nodes if len(node.roads) > len(APPROACHES)]
    if many:
        yield f"more than four roads share the four approaches of: {_listed(many)}"
    unserved = [f"{node.id} {name}" for node in nodes for name in _unserved(node)]
    if unserved:
        yield f"no phase serves, so nobody gets through: {_listed(unserved)}"
    apart = [lane for node in nodes for lane in _apart(node)]
    if apart:
        yield (
            "lanes whose movements are never green together, so that one blocks the other: "
            f"{_listed(apart)}"
        )


def _unserved(node: IntersectionRecord) -> list[str]:
    """The slots with a link that is green in no phase."""
    slots = {node.links[k].slot for k, phases in enumerate(_greens(node)) if not phases}
    return [slot_name(slot) for slot in sorted(slots)]


def _apart(node: IntersectionRecord) -> list[str]:
    """The lanes with two links that have greens, and none in common."""
    greens = _greens(node)
    lanes: dict[str, list[set[int]]] = {}
    for link, phases in zip(node.links, greens, strict=True):
        if phases:
            lanes.setdefault(link.from_lane, []).append(phases)
    return [lane for lane, sets in lanes.items() if not set.intersection(*sets)]


def _greens(node: IntersectionRecord) -> list[set[int]]:
    """For each link the phases in which it is green."""
    return [
        {p for p, phase in enumerate(node.phases) if k in phase.links or k in node.free}
        for k in range(len(node.links))
    ]


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more
