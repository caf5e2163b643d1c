"""The twelve movement slots of an intersection and the assignment of roads to approaches.

A slot is ``3 * approach + turn``. An approach is named by the compass direction that its traffic
comes *from*: north, east, south, west (0 to 3, clockwise). Turns are left, straight, right
(0 to 2). ``slot_name(4)`` is ``"E-straight"``: vehicles that come from the east and go west.
"""

import itertools
import math
from collections.abc import Sequence

APPROACHES = ("N", "E", "S", "W")
TURNS = ("left", "straight", "right")
LEFT, STRAIGHT, RIGHT = range(3)
RIGHT_OF_WAY = {STRAIGHT: 0, LEFT: 1, RIGHT: 2}  # where two conflict, the lower goes first
N_SLOTS = len(APPROACHES) * len(TURNS)

MAX_NEIGHBOURS = 3  # upstream slots kept for a slot: the left, straight and right that feed a road


def slot_index(approach: int, turn: int) -> int:
    """The slot of a turn from an approach."""
    return approach * len(TURNS) + turn


def slot_name(slot: int) -> str:
    """For example ``"N-left"`` for slot 0."""
    return f"{APPROACHES[slot // len(TURNS)]}-{TURNS[slot % len(TURNS)]}"


def bearing(dx: float, dy: float) -> float:
    """Compass bearing in degrees, 0 = north (+y), 90 = east (+x), of a vector in metres."""
    return math.degrees(math.atan2(dx, dy)) % 360.0


def _deviation(degrees: float, approach: int) -> float:
    difference = abs(degrees - 90.0 * approach) % 360.0
    return min(difference, 360.0 - difference)


def _nearest_approach(degrees: float) -> int:
    return min(range(len(APPROACHES)), key=lambda approach: _deviation(degrees, approach))


def assign_approaches(bearings: Sequence[float]) -> list[int]:
    """An approach (0 to 3) for each incoming road, given the bearing [degrees] it comes from.

    Up to four roads get approaches of their own, with the least squared deviation from the
    compass directions; where there are more, each takes the nearest approach and some share one.
    """
    if len(bearings) > len(APPROACHES):
        return [_nearest_approach(degrees) for degrees in bearings]
    best = min(
        itertools.permutations(range(len(APPROACHES)), len(bearings)),
        key=lambda p: sum(_deviation(b, a) ** 2 for b, a in zip(bearings, p, strict=True)),
    )
    return list(best)
