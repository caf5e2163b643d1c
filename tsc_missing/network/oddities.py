"""What is odd about the signals of a network that was imported as its file has it."""

from collections.abc import Iterator

import numpy as np

from tsc_missing.network.model import Network
from tsc_missing.network.records import IntersectionRecord
from tsc_missing.network.slots import APPROACHES, slot_name

SHOWN = 5  # at most, of each kind
APART = "lanes whose movements are never green together, so that one blocks the other"


def oddities(network: Network) -> Iterator[str]:
    """Notes in words, one of each kind."""
    for words, found in (
        ("more than four roads share the four approaches of", crowded(network)),
        ("no phase serves, so nobody gets through", unserved(network)),
        (APART, apart(network)),
    ):
        if found:
            yield f"{words}: {_listed(found)}"


def crowded(network: Network) -> list[str]:
    """The intersections with more roads than approaches."""
    return [node.id for node in network.intersections if len(node.roads) > len(APPROACHES)]


def unserved(network: Network) -> list[str]:
    """The slots that no phase serves, with their intersections."""
    served = network.phases.any(axis=1) | network.free_slots
    return [
        f"{network.ids[n]} {slot_name(int(slot))}"
        for n, slot in zip(*np.nonzero(network.slot_mask & ~served), strict=True)
    ]


def apart(network: Network) -> list[str]:
    """The lanes with two links that have greens, and none in common."""
    found = []
    for node in network.intersections:
        lanes: dict[str, list[set[int]]] = {}
        for link, phases in zip(node.links, _greens(node), strict=True):
            if phases:
                lanes.setdefault(link.from_lane, []).append(phases)
        found += [lane for lane, sets in lanes.items() if not set.intersection(*sets)]
    return found


def _greens(node: IntersectionRecord) -> list[set[int]]:
    """For each link the phases in which it is green."""
    return [
        {p for p, phase in enumerate(node.phases) if k in phase.links or k in node.free}
        for k in range(len(node.links))
    ]


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more
