"""From chosen phases to signal states: yellow, clearing, minimum green, and a guard on all of it.

``Signals`` plans the states; ``SignalGuard`` knows nothing of the plan and checks every state
that is sent, so that a fault in the plan stops the run before SUMO sees it.
"""

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from tsc_missing.config import SignalSettings
from tsc_missing.network.model import IntArray, Network
from tsc_missing.network.records import IntersectionRecord
from tsc_missing.simulation.states import (
    GREEN,
    SignalSafetyError,
    check_state,
    green_state,
    red_state,
    sumo_state,
    yellow_state,
)

Send = Callable[[str, str], None]  # (traffic light id, state)
FORBIDDEN = {  # colours before and after
    "gr": "from green to red without yellow",
    "ry": "from red to yellow",
    "yg": "from yellow back to green",
}


@dataclass(frozen=True)
class Change:
    """From one state to another: the links whose colour changes, and those that must have lasted.

    A change to yellow asks for the minimum green, one from yellow to red for the yellow time.
    """

    links: tuple[int, ...]
    from_green: tuple[int, ...]
    from_yellow: tuple[int, ...]


class SignalGuard:
    """Passes states on to the simulator after checking them against the rules of safety."""

    def __init__(self, network: Network, settings: SignalSettings, send: Send) -> None:
        """Nothing has been sent yet; every link counts as red since long."""
        self._nodes = network.intersections
        self._send = send
        self._min_green = [settings.min_green_at(node) for node in self._nodes]
        self._yellow = [settings.yellow_at(node) for node in self._nodes]
        self._known: list[dict[tuple[str, str], Change]] = [{} for _ in self._nodes]
        self._states = ["r" * len(node.links) for node in self._nodes]
        self._since = [[-np.inf] * len(node.links) for node in self._nodes]

    def send(self, n: int, state: str, time: float) -> None:
        """Send a state at ``time`` [s]; ``SignalSafetyError`` and nothing sent if it is unsafe."""
        node, since = self._nodes[n], self._since[n]
        change = self._change(n, state)
        _check_lasted(node, "green", change.from_green, since, time, self._min_green[n])
        _check_lasted(node, "yellow", change.from_yellow, since, time, self._yellow[n])
        for link in change.links:
            since[link] = time
        self._states[n] = state
        self._send(node.id, sumo_state(node, state))

    def fork(self) -> Self:
        """A guard that goes on from here by itself and sends to the same simulation."""
        other = copy.copy(self)
        other._states, other._since = list(self._states), [list(since) for since in self._since]
        return other

    def repeat(self) -> None:
        """Send what stands now again."""
        for node, state in zip(self._nodes, self._states, strict=True):
            self._send(node.id, sumo_state(node, state))

    def _change(self, n: int, state: str) -> Change:
        """The change to a state that is legal, by colours that may follow each other."""
        before = self._states[n]
        known = self._known[n].get((before, state))
        if known is None:
            node = self._nodes[n]
            check_state(node, state, before)
            pairs = ((_colour(old), _colour(new)) for old, new in zip(before, state, strict=True))
            colours = {link: a + b for link, (a, b) in enumerate(pairs) if a != b}
            for link, words in colours.items():
                if words in FORBIDDEN:
                    raise SignalSafetyError(f"{node.id} link {link}: {FORBIDDEN[words]}")
            known = Change(
                tuple(colours),
                tuple(link for link, words in colours.items() if words == "gy"),
                tuple(link for link, words in colours.items() if words == "yr"),
            )
            self._known[n][before, state] = known
        return known


def _check_lasted(
    node: IntersectionRecord,
    colour: str,
    links: tuple[int, ...],
    since: Sequence[float],
    time: float,
    least: float,
) -> None:
    for link in links:
        if time - since[link] < least:
            raise SignalSafetyError(
                f"{node.id} link {link}: {colour} ends after {time - since[link]:g} s, "
                f"before {least} s"
            )


def _colour(letter: str) -> str:
    return "g" if letter in GREEN else letter


class Signals:
    """The signals of a network: what they show, and how they get from phase to phase.

    In a decision step ``command`` is called at its start, and at each of the ``moments`` that
    follow ``clear`` (after the yellow) and ``release`` (after the all-red time); they act on the
    intersections that have come so far. A phase that does not change stays green throughout.
    """

    def __init__(self, network: Network, settings: SignalSettings, send: Send) -> None:
        """All links red but those that are free in every phase."""
        self._network = network
        self._settings = settings
        self._guard = SignalGuard(network, settings, send)
        self.phase: IntArray = np.full(network.n, -1, dtype=np.int64)
        self._shown = [green_state(node, None) for node in network.intersections]
        nodes = network.intersections
        self._yellow = [settings.yellow_at(node) for node in nodes]
        self._min_green = np.array([settings.min_green_at(node) for node in nodes])
        self._changing: dict[int, float] = {}  # when the yellow is over
        self._targets = list(self._shown)
        self._greens = [
            [green_state(node, phase) for phase in range(len(node.phases))]
            for node in network.intersections
        ]
        self._green_since = np.full(network.n, -np.inf)
        self.red_steps: IntArray = network.first_red_steps()
        self.held = 0
        for n, state in enumerate(self._shown):
            self._guard.send(n, state, 0.0)

    def fork(self) -> Self:
        """Signals that go on from here by themselves, between two steps.

        They send to the same simulation; ``repeat`` of these takes it back to what these show.
        """
        other = copy.copy(self)
        other._guard = self._guard.fork()
        other._shown, other._targets = list(self._shown), list(self._targets)
        other._changing, other._green_since = {}, self._green_since.copy()
        return other

    def repeat(self) -> None:
        """Send what the signals show now again, after the simulation was taken back."""
        self._guard.repeat()

    def command(self, phases: IntArray, now: float) -> bool:
        """Start the step at ``now`` [s] towards ``phases`` (N,); true if any signal turns yellow.

        A phase whose minimum green is not over stays, whatever was asked (counted in ``held``).
        """
        held = (phases != self.phase) & (now - self._green_since < self._min_green)
        self.held += int(held.sum())
        phases = np.where(held, self.phase, phases)
        changed = [int(n) for n in np.flatnonzero(phases != self.phase)]
        self._changing = {}
        for n in changed:
            target = self._greens[n][phases[n]]
            between = yellow_state(self._shown[n], target)
            self._targets[n] = target
            if "y" in between:
                self._changing[n] = now + self._yellow[n]
                self._guard.send(n, between, now)
                self._green_since[n] = self._changing[n] + self._settings.all_red
            else:
                self._show(n, now)
                self._green_since[n] = now
        self.phase = phases.astype(np.int64)
        self.red_steps = self._network.next_red_steps(self.red_steps, self.phase)
        return bool(self._changing)

    @property
    def moments(self) -> list[float]:
        """The times [s] at which a yellow or an all-red that runs will be over."""
        yellows = set(self._changing.values())
        return sorted(yellows | {over + self._settings.all_red for over in yellows})

    def clear(self, now: float) -> None:
        """All-red at the intersections whose yellow is over now."""
        for n, over in self._changing.items():
            if over == now and self._settings.all_red:
                self._guard.send(n, red_state(self._shown[n], self._targets[n]), now)

    def release(self, now: float) -> None:
        """Green for the new phases where the clearing is over."""
        ready = [n for n, over in self._changing.items() if over + self._settings.all_red <= now]
        for n in ready:
            self._show(n, now)
            del self._changing[n]

    def _show(self, n: int, now: float) -> None:
        self._shown[n] = self._targets[n]
        self._guard.send(n, self._shown[n], now)
