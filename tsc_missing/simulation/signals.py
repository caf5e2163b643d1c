"""From chosen phases to signal states: yellow, clearing, minimum green, and a guard on all of it.

``Signals`` plans the states; ``SignalGuard`` knows nothing of the plan and checks every state
that is sent, so that a fault in the plan stops the run before SUMO sees it.
"""

from collections.abc import Callable

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
Changes = tuple[tuple[int, str], ...]  # (link, its colour before and after)


class SignalGuard:
    """Passes states on to the simulator after checking them against the rules of safety."""

    def __init__(self, network: Network, settings: SignalSettings, send: Send) -> None:
        """Nothing has been sent yet; every link counts as red since long."""
        self._network = network
        self._settings = settings
        self._send = send
        self._known: list[dict[tuple[str, str], Changes]] = [{} for _ in network.intersections]
        self._states = ["r" * len(node.links) for node in network.intersections]
        self._since = [[-np.inf] * len(node.links) for node in network.intersections]

    def send(self, n: int, state: str, time: float) -> None:
        """Send a state at ``time`` [s]; ``SignalSafetyError`` and nothing sent if it is unsafe."""
        node, since = self._network.intersections[n], self._since[n]
        changes = self._changes(n, state)
        for link, change in changes:
            self._check_change(node, link, change, time - since[link])
        for link, _ in changes:
            since[link] = time
        self._states[n] = state
        self._send(node.id, sumo_state(node, state))

    def _changes(self, n: int, state: str) -> Changes:
        """The links whose colour changes, as "gy" for green to yellow; the state is legal."""
        before = self._states[n]
        known = self._known[n].get((before, state))
        if known is None:
            check_state(self._network.intersections[n], state, before)
            pairs = ((_colour(old), _colour(new)) for old, new in zip(before, state, strict=True))
            known = tuple((link, a + b) for link, (a, b) in enumerate(pairs) if a != b)
            self._known[n][before, state] = known
        return known

    def _check_change(
        self, node: IntersectionRecord, number: int, change: str, lasted: float
    ) -> None:
        link = f"{node.id} link {number}"
        yellow, min_green = self._settings.yellow_at(node), self._settings.min_green_at(node)
        if change == "gr":
            raise SignalSafetyError(f"{link}: from green to red without yellow")
        if change == "gy" and lasted < min_green:
            raise SignalSafetyError(f"{link}: green ends after {lasted:g} s, before {min_green} s")
        if change == "yr" and lasted < yellow:
            raise SignalSafetyError(f"{link}: yellow ends after {lasted:g} s, before {yellow} s")
        if change == "ry":
            raise SignalSafetyError(f"{link}: from red to yellow")
        if change == "yg":
            raise SignalSafetyError(f"{link}: from yellow back to green")


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
        self.red_steps: IntArray = np.where(network.free_slots, 0, 1).astype(np.int64)
        self.held = 0
        for n, state in enumerate(self._shown):
            self._guard.send(n, state, 0.0)

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
        self._count_red()
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

    def _count_red(self) -> None:
        served = self._network.phases[np.arange(self._network.n), self.phase]
        green = served | self._network.free_slots
        self.red_steps = np.where(green, 0, self.red_steps + 1)
