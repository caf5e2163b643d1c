"""Whether the phases that a file gives an intersection can be driven."""

from collections.abc import Iterator

from tsc_missing.network.plain import PlainNetwork
from tsc_missing.network.records import IntersectionRecord, NetworkRecord
from tsc_missing.network.slots import LEFT, STRAIGHT, TURNS

ONCOMING = 120.0  # [degrees] at least between the directions that two roads come from


def conflicting_phases(record: NetworkRecord, plain: PlainNetwork) -> Iterator[str]:
    """Words for each phase that lets two movements go of which neither can give way.

    Who turns to the near side gives way, and so does who turns across oncoming traffic, and of one
    road's lanes that cross the one that the junction's rules name. All other movements that cross
    each other need greens of their own.
    """
    for node in record.intersections:
        for phase in node.phases:
            pair = _conflict(node, (*phase.links, *node.free), plain)
            if pair is not None:
                first, second = (_words(node, link, plain) for link in pair)
                where = f"intersection {node.id}, light phase {phase.name}"
                yield f"{where}: {first} and {second} cross, and neither can give way"


def _conflict(
    node: IntersectionRecord, served: tuple[int, ...], plain: PlainNetwork
) -> tuple[int, int] | None:
    for one in served:
        for other in set(node.foes[one]).intersection(served):
            if not (_gives_way(node, one, other, plain) or _gives_way(node, other, one, plain)):
                return one, other
    return None


def _gives_way(node: IntersectionRecord, link: int, foe: int, plain: PlainNetwork) -> bool:
    if foe not in node.yields[link]:
        return False
    if _road(node, link) == _road(node, foe):
        return True
    turn = _turn(node, link, plain)
    return turn not in (LEFT, STRAIGHT) or _is_oncoming(node, link, foe, plain)


def _is_oncoming(node: IntersectionRecord, link: int, foe: int, plain: PlainNetwork) -> bool:
    one, other = (plain.comes_from(plain.nodes[node.id], _road(node, k)) for k in (link, foe))
    apart = abs(one - other)
    return min(apart, 360.0 - apart) >= ONCOMING


def _turn(node: IntersectionRecord, link: int, plain: PlainNetwork) -> int:
    lanes = node.links[link].from_lane, node.links[link].to_lane
    roads = tuple(lane.rpartition("_")[0] for lane in lanes)
    moves = plain.nodes[node.id].movements
    return next(move.turn for move in moves if (move.from_road, move.to_road) == roads)


def _road(node: IntersectionRecord, link: int) -> str:
    return node.links[link].from_lane.rpartition("_")[0]


def _words(node: IntersectionRecord, link: int, plain: PlainNetwork) -> str:
    return f"{TURNS[_turn(node, link, plain)]} from {_road(node, link)}"
