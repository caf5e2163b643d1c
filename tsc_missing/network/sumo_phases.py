"""Phases of a signal from the conflicts of its movements.

Links that must be green together are a *unit*: those of a slot, those that leave one lane (a lane
shared by two movements), and those that one lamp of the signal shows. Two units may share a phase
if none of their links conflict, but for conflicts where one link may give way without a light of
its own: turns to the near side, turns back, and, from lanes that straight traffic shares, turns
across the oncoming traffic. Phases are the largest sets of such units. The fewest that serve every
unit are kept; on a plain four-armed intersection these are the four of the literature.
"""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from tsc_missing.network.records import PhaseRecord
from tsc_missing.network.slots import APPROACHES, STRAIGHT, TURNS
from tsc_missing.network.sumo_links import Signal

EXACT = 24  # phases up to which the fewest that serve all are searched for among all choices
LETTERS = "LTR"  # of the turns, in phase names

Unit = frozenset[int]


@dataclass(frozen=True)
class Plan:
    """The phases of a signal, the links that are always green, and who gives way to whom.

    ``yields[i]`` are the links that link i gives way to when both are green: of the conflicts that
    the junction's rules settle only those that phases rely on.
    """

    phases: tuple[PhaseRecord, ...]
    free: tuple[int, ...]
    yields: tuple[tuple[int, ...], ...]


def plan_phases(signal: Signal, all_phases: bool = False) -> Plan:
    """The phases of a signal; with ``all_phases`` every largest set of units is one."""
    links = range(len(signal.links))
    free = _free(signal)
    units = _units(signal, [i for i in links if i not in free])
    mixed = {i for unit in units if _is_mixed(signal, unit) for i in unit}
    gentle = _gentle_conflicts(signal, units, free, mixed)
    riders = [unit for unit in units if _is_rider(signal, unit, units)]
    phases = _choose(signal, units, riders, gentle, all_phases)
    while lonely := [rider for rider in riders if not any(rider <= green for _, green in phases)]:
        riders = [rider for rider in riders if rider not in lonely]
        phases = _choose(signal, units, riders, gentle, all_phases)
    names = _names([main for main, _ in phases], signal)
    return Plan(
        phases=tuple(
            PhaseRecord(name=name, links=tuple(sorted(green)))
            for name, (_, green) in zip(names, phases, strict=True)
        ),
        free=tuple(sorted(free)),
        yields=tuple(tuple(sorted(j for j in links if (i, j) in gentle)) for i in links),
    )


def _choose(
    signal: Signal,
    units: Sequence[Unit],
    riders: Sequence[Unit],
    gentle: set[tuple[int, int]],
    all_phases: bool,
) -> list[tuple[Unit, Unit]]:
    """The phases in order: the links that they are made for, and all that are green."""
    main = [unit for unit in units if unit not in riders]
    together = {
        (a, b)
        for a, b in itertools.permutations(range(len(main)), 2)
        if not _hard(signal, main[a], main[b], gentle)
    }
    found = sorted(_cliques(len(main), together))
    chosen = found if all_phases else _cover(signal, main, found)
    made_for = [frozenset[int]().union(*(main[u] for u in phase)) for phase in chosen]
    made_for.sort(key=lambda green: _order(signal, green))
    return [(green, _with_riders(signal, green, riders, gentle)) for green in made_for]


def _free(signal: Signal) -> frozenset[int]:
    """Links that the net's own program never stops, if the junction's rules allow that."""
    never = {i for i, link in enumerate(signal.links) if not link.stopped}
    for i in sorted(never):
        place = signal.links[i].place
        shown_with = {j for j, link in enumerate(signal.links) if link.place == place}
        if not all(k in never and _may_always_go(signal, k) for k in shown_with):
            never -= shown_with
    return frozenset(never)


def _may_always_go(signal: Signal, link: int) -> bool:
    """Whether a link gives way wherever it conflicts, or a turn to it, but no straight traffic."""
    return all(
        foe in signal.gives_way[link]
        or (link in signal.gives_way[foe] and signal.links[foe].turn != STRAIGHT)
        for foe in signal.foes[link]
    )


def _units(signal: Signal, links: Sequence[int]) -> list[Unit]:
    """The links that must be green together, as far as no conflict forbids it."""
    units: list[Unit] = []
    for i in links:
        near = [unit for unit in units if any(_go_together(signal, i, j) for j in unit)]
        units = [unit for unit in units if unit not in near]
        units.append(frozenset([i]).union(*near))
    joined: list[Unit] = []
    for unit in sorted(units, key=min):  # roads that share an approach
        slots = {signal.links[i].slot for i in unit}
        for k, other in enumerate(joined):
            same = any(signal.links[j].slot in slots for j in other)
            if same and not any(_unsettled(signal, i, j) for i in unit for j in other):
                joined[k] = unit | other
                break
        else:
            joined.append(unit)
    return joined


def _go_together(signal: Signal, i: int, j: int) -> bool:
    """Whether two links share a lamp, a lane, or both the road and the slot."""
    first, second = signal.links[i], signal.links[j]
    return (
        first.place == second.place
        or first.from_lane == second.from_lane
        or (first.slot == second.slot and first.road == second.road)
    )


def _unsettled(signal: Signal, i: int, j: int) -> bool:
    """Whether two links conflict and the junction's rules do not say who goes first."""
    return j in signal.foes[i] and not (j in signal.gives_way[i] or i in signal.gives_way[j])


def _is_mixed(signal: Signal, unit: Unit) -> bool:
    """Whether straight traffic shares a lane with a turn across the oncoming traffic."""
    turns = {(signal.links[i].turn, signal.links[i].near) for i in unit}
    across = any(turn != STRAIGHT and not near for turn, near in turns)
    return across and any(turn == STRAIGHT for turn, _ in turns)


def _is_rider(signal: Signal, unit: Unit, units: Sequence[Unit]) -> bool:
    """Whether a unit only turns to the near side or back, beside other units of its approach."""
    light = all(signal.links[i].near or signal.links[i].turns_back for i in unit)
    roads = {signal.links[i].road for i in unit}
    others = (other for other in units if other != unit)
    return light and any(
        signal.links[i].road in roads and not (signal.links[i].near or signal.links[i].turns_back)
        for other in others
        for i in other
    )


def _gentle_conflicts(
    signal: Signal, units: Sequence[Unit], free: frozenset[int], mixed: set[int]
) -> set[tuple[int, int]]:
    """Pairs (i, j) of links that conflict and may be green together because i gives way to j."""
    unit_of = {i: number for number, unit in enumerate(units) for i in unit}
    pairs = set()
    for i, link in enumerate(signal.links):
        for j in signal.foes[i] & signal.gives_way[i]:
            other = signal.links[j]
            across = not link.near and link.turn != STRAIGHT
            oncoming = (link.slot // len(TURNS) - other.slot // len(TURNS)) % len(APPROACHES) == 2
            if (
                link.near
                or link.turns_back
                or i in free
                or j in free
                or (i in unit_of and unit_of[i] == unit_of.get(j))
                or (i in mixed and across and oncoming)
            ):
                pairs.add((i, j))
    return pairs


def _hard(signal: Signal, first: Unit, second: Unit, gentle: set[tuple[int, int]]) -> bool:
    """Whether some link of one unit must not be green beside some link of the other."""
    return any(
        (i, j) not in gentle and (j, i) not in gentle
        for i in first
        for j in signal.foes[i] & second
    )


def _cliques(count: int, together: set[tuple[int, int]]) -> Iterator[tuple[int, ...]]:
    """The largest sets of units that may all be green together (Bron and Kerbosch, 1973)."""
    near = [{b for b in range(count) if (a, b) in together} for a in range(count)]

    def extend(chosen: set[int], open_: set[int], done: set[int]) -> Iterator[tuple[int, ...]]:
        if not open_ and not done:
            yield tuple(sorted(chosen))
            return
        pivot = max(sorted(open_ | done), key=lambda u: len(near[u] & open_))
        for u in sorted(open_ - near[pivot]):
            yield from extend(chosen | {u}, open_ & near[u], done & near[u])
            open_, done = open_ - {u}, done | {u}

    if count:
        yield from extend(set(), set(range(count)), set())


def _cover(
    signal: Signal, units: Sequence[Unit], cliques: Sequence[tuple[int, ...]]
) -> list[tuple[int, ...]]:
    """The fewest sets that hold every unit; of as few those that pair like movements."""
    everything = set(range(len(units)))
    if len(cliques) > EXACT:
        return _greedy(everything, cliques)
    for size in range(1, len(cliques) + 1):
        covers = [
            cover
            for cover in itertools.combinations(cliques, size)
            if set(itertools.chain(*cover)) == everything
        ]
        if covers:
            best = min(covers, key=lambda cover: _unlike(signal, units, cover))
            return list(best)
    return []


def _greedy(everything: set[int], cliques: Sequence[tuple[int, ...]]) -> list[tuple[int, ...]]:
    chosen: list[tuple[int, ...]] = []
    left = set(everything)
    while left:
        chosen.append(max(cliques, key=lambda phase: (len(left.intersection(phase)), len(phase))))
        left -= set(chosen[-1])
    return chosen


def _unlike(
    signal: Signal, units: Sequence[Unit], cover: Iterable[tuple[int, ...]]
) -> tuple[int, int]:
    """How many phases pair a straight movement with another that is none, and links green, less."""
    mixtures, links = 0, 0
    for phase in cover:
        straight = [any(signal.links[i].turn == STRAIGHT for i in units[u]) for u in phase]
        mixtures += any(straight) and not all(straight)
        links += sum(len(units[u]) for u in phase)
    return mixtures, -links


def _with_riders(
    signal: Signal, phase: Unit, riders: Sequence[Unit], gentle: set[tuple[int, int]]
) -> Unit:
    """The links of a phase, with the near-side turns that go along.

    These are the ones that conflict with nothing in it, and those that may give way and whose
    road has another movement in it.
    """
    links = phase
    roads = {signal.links[i].road for i in phase}
    for rider in riders:
        beside = any(signal.links[i].road in roads for i in rider)
        quiet = not any(signal.foes[i] & links for i in rider)
        if quiet or (beside and not _hard(signal, rider, links, gentle)):
            links |= rider
    return links


def _names(phases: Sequence[Unit], signal: Signal) -> list[str]:
    """For example ``ET_WT`` for straight on from east and west; numbered where that is not one."""
    names = []
    for phase in phases:
        turns: dict[str, str] = {}
        for slot in sorted({signal.links[i].slot for i in phase}):
            approach = APPROACHES[slot // len(TURNS)]
            turns[approach] = turns.get(approach, "") + LETTERS[slot % len(TURNS)]
        names.append("_".join(approach + made for approach, made in turns.items()))
    return [
        name if names.count(name) == 1 else f"{name}.{names[:k].count(name) + 1}"
        for k, name in enumerate(names)
    ]


def _order(signal: Signal, phase: Unit) -> tuple[bool, int, int]:
    """Straight movements first, then those with more links."""
    straight = any(signal.links[i].turn == STRAIGHT for i in phase)
    return not straight, -len(phase), min(phase)
