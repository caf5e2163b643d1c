"""Signal states as SUMO spells them: one letter a link.

``G`` green with priority, ``g`` green but gives way, ``y`` yellow, ``r`` red.
"""

from functools import lru_cache

from tsc_missing.network.records import IntersectionRecord

GREEN = "Gg"


class SignalSafetyError(RuntimeError):
    """A state or a change of state that must never reach the signals."""


def green_state(node: IntersectionRecord, phase: int | None) -> str:
    """The state of a phase; ``None`` gives green to the free links only.

    A served link that must give way to another served link gets ``g``.
    """
    served = set(node.free) | (set(node.phases[phase].links) if phase is not None else set())
    return "".join(
        "r" if link not in served else "g" if served.intersection(node.yields[link]) else "G"
        for link in range(len(node.links))
    )


def sumo_state(node: IntersectionRecord, state: str) -> str:
    """A state of the links as SUMO wants it: by places of its state string.

    Where links share a place they must be of one colour, and give way if one of them does; places
    without a link are red.
    """
    if node.positions is None:
        return state
    letters = ["r"] * (node.state_length or 0)
    taken: dict[int, str] = {}
    for link, place in enumerate(node.positions):
        letter, before = state[link], taken.get(place, state[link])
        if letter.lower() != before.lower():
            raise SignalSafetyError(
                f"{node.id}: links that share place {place} would be {before} and {letter}"
            )
        letters[place] = taken[place] = max(letter, before)  # "g" comes after "G"
    return "".join(letters)


@lru_cache(maxsize=4096)
def yellow_state(before: str, after: str) -> str:
    """The state between two: yellow for links that turn red; links that stay green go on.

    A link that gives way on either side of the change gives way during it.
    """
    return "".join(_between(a, b) for a, b in zip(before, after, strict=True))


def _between(before: str, after: str) -> str:
    if before not in GREEN:
        return "r"
    if after not in GREEN:
        return "y"
    return "g" if "g" in (before, after) else "G"


def red_state(before: str, after: str) -> str:
    """The clearing state after the yellow: only links that are green before and after stay so."""
    return yellow_state(before, after).replace("y", "r")


def check_state(node: IntersectionRecord, state: str, before: str = "") -> None:
    """Raise ``SignalSafetyError`` unless the state is legal at this intersection.

    Of two conflicting links that may both move (green or yellow), one must be green that gives
    way (``g``) to the other, or one that gives way must have turned yellow while the other stays
    green: both were green in the legal state ``before``, and SUMO's ``y`` gives way too.
    """
    if len(state) != len(node.links) or set(state) - set("Ggyr"):
        raise SignalSafetyError(
            f"{node.id}: state {state!r} is not {len(node.links)} letters out of G, g, y, r"
        )
    for link, letter in enumerate(state):
        for foe in node.foes[link]:
            if letter == "r" or state[foe] == "r":
                continue
            if foe < link and link in node.foes[foe]:
                continue  # looked at from the other side
            going_on = bool(before) and before[link] in GREEN and before[foe] in GREEN
            giving = "gy" if going_on else "g"
            gives_way = (letter in giving and foe in node.yields[link]) or (
                state[foe] in giving and link in node.yields[foe]
            )
            if not gives_way:
                raise SignalSafetyError(
                    f"{node.id}: state {state!r} lets links {link} and {foe} go, which conflict"
                )
