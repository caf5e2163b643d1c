"""The invariants of the signals: whatever is asked of them, and whatever is sent to the guard."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from tests.networks import grid_network
from tsc_missing.config import SignalSettings
from tsc_missing.network.model import Network
from tsc_missing.network.records import IntersectionRecord
from tsc_missing.simulation.signals import SignalGuard, Signals
from tsc_missing.simulation.states import (
    SignalSafetyError,
    check_state,
    green_state,
    red_state,
    sumo_state,
    yellow_state,
)

NETWORK = grid_network(2, 3)
NODE = NETWORK.intersections[0]


class Recorder:
    """Stands for SUMO: keeps each light's states with the times at which they came."""

    def __init__(self) -> None:
        self.now = 0.0
        self.states: dict[str, list[tuple[float, str]]] = {}

    def send(self, light: str, state: str) -> None:
        self.states.setdefault(light, []).append((self.now, state))


def drive(timing: SignalSettings, decisions: list[list[int]]) -> Recorder:
    """Command the decisions one interval after the other, as the closed loop does."""
    recorder = Recorder()
    signals = Signals(NETWORK, timing, recorder.send)
    for step, phases in enumerate(decisions):
        recorder.now = step * timing.decision_interval
        if signals.command(np.array(phases), recorder.now):
            recorder.now += timing.yellow
            if timing.all_red:
                signals.clear(recorder.now)
                recorder.now += timing.all_red
            signals.release(recorder.now)
    return recorder


TIMINGS = st.builds(
    lambda yellow, all_red, green, min_green: SignalSettings(
        decision_interval=yellow + all_red + green,
        yellow=yellow,
        all_red=all_red,
        min_green=min_green,
    ),
    yellow=st.integers(1, 6),
    all_red=st.integers(0, 3),
    green=st.integers(1, 20),
    min_green=st.integers(0, 45),
)
DECISIONS = st.lists(
    st.lists(st.integers(0, 3), min_size=NETWORK.n, max_size=NETWORK.n), min_size=1, max_size=25
)


@given(timing=TIMINGS, decisions=DECISIONS)
@settings(max_examples=60)
def test_no_order_of_phases_breaks_a_rule(timing, decisions):
    recorder = drive(timing, decisions)
    for node in NETWORK.intersections:
        states = recorder.states[node.id]
        turned_green = [-np.inf] * len(node.links)
        turned_yellow = [0.0] * len(node.links)
        for (_, before), (time, after) in itertools.pairwise(states):
            for link, (old, new) in enumerate(zip(before, after, strict=True)):
                if old in "Gg" and new == "y":
                    assert time - turned_green[link] >= timing.min_green
                    turned_yellow[link] = time
                if old == "y" and new != "y":
                    assert new == "r"
                    assert time - turned_yellow[link] == timing.yellow
                if old not in "Gg" and new in "Gg":
                    turned_green[link] = time
                assert not (old in "Gg" and new == "r")
            moving = [link for link, letter in enumerate(after) if letter != "r"]
            for a in moving:
                for b in moving:
                    if b in node.foes[a]:
                        assert "g" in (after[a], after[b])


@given(decisions=DECISIONS)
@settings(max_examples=20)
def test_free_links_are_always_green(decisions):
    recorder = drive(SignalSettings(), decisions)
    for node in NETWORK.intersections:
        for _, state in recorder.states[node.id]:
            assert all(state[link] in "Gg" for link in node.free)


def test_all_red_clears_everything_that_changes():
    timing = SignalSettings(decision_interval=15, yellow=4, all_red=2)
    recorder = drive(timing, [[0] * NETWORK.n, [1] * NETWORK.n])
    times = [time for time, _ in recorder.states[NODE.id]]
    assert times == [0.0, 0, 15, 19, 21]
    clearing = recorder.states[NODE.id][3][1]
    assert {clearing[link] for phase in NODE.phases for link in phase.links} == {"r"}


def test_phase_that_stays_is_sent_nothing():
    recorder = drive(SignalSettings(), [[2] * NETWORK.n] * 4)
    assert len(recorder.states[NODE.id]) == 2


def test_minimum_green_longer_than_a_step_holds_the_phase():
    timing = SignalSettings(min_green=25)
    recorder = Recorder()
    signals = Signals(NETWORK, timing, recorder.send)
    for step, wanted in enumerate([0, 1, 1, 0]):
        signals.command(np.full(NETWORK.n, wanted), 15.0 * step)
        signals.release(15.0 * step + 5)
    assert signals.phase.tolist() == [1] * NETWORK.n
    assert signals.held == 2 * NETWORK.n


def test_red_steps_count_from_the_last_green():
    signals = Signals(NETWORK, SignalSettings(), lambda light, state: None)
    for step, wanted in enumerate([0, 1, 1]):
        signals.command(np.full(NETWORK.n, wanted), 15.0 * step)
        signals.release(15.0 * step + 5)
    served = NETWORK.phases[0]
    assert (signals.red_steps[0][served[1]] == 0).all()
    assert (signals.red_steps[0][served[0]] == 2).all()
    assert (signals.red_steps[0][NETWORK.free_slots[0]] == 0).all()


def test_two_conflicting_greens_never_reach_the_simulator():
    sent = []
    guard = SignalGuard(NETWORK, SignalSettings(), lambda *call: sent.append(call))
    with pytest.raises(SignalSafetyError, match="conflict"):
        guard.send(0, "G" * len(NODE.links), 0.0)
    assert sent == []


def test_yellow_counts_as_moving():
    first, second = green_state(NODE, 0), green_state(NODE, 1)
    mixed = "".join(
        "y" if a in "Gg" and b == "r" else b for a, b in zip(first, second, strict=True)
    )
    with pytest.raises(SignalSafetyError, match="conflict"):
        check_state(NODE, mixed)


@pytest.mark.parametrize("state", ["", "GG", "x" * len(NODE.links)])
def test_states_that_are_no_states_are_refused(state):
    with pytest.raises(SignalSafetyError, match="letters"):
        check_state(NODE, state)


@pytest.mark.parametrize(
    ("states", "words"),
    [
        ([(0.0, 0), (20.0, "next")], "without yellow"),
        ([(0.0, 0), (4.0, "yellow")], "green ends after"),
        ([(0.0, 0), (20.0, "yellow"), (22.0, "red")], "yellow ends after"),
        ([(0.0, 0), (20.0, "yellow"), (25.0, 0)], "from yellow back to green"),
        ([(0.0, None), (20.0, "yellow")], "from red to yellow"),
    ],
)
def test_the_guard_refuses_bad_changes(states, words):
    first, second = green_state(NODE, 0), green_state(NODE, 1)
    named = {
        0: first,
        None: green_state(NODE, None),
        "next": second,
        "yellow": yellow_state(first, second),
        "red": red_state(first, second),
    }
    guard = SignalGuard(NETWORK, SignalSettings(), lambda light, state: None)
    for time, name in states[:-1]:
        guard.send(0, named[name], time)
    with pytest.raises(SignalSafetyError, match=words):
        guard.send(0, named[states[-1][1]], states[-1][0])


def test_every_intersection_keeps_its_own_yellow():
    first, *others = NETWORK.intersections
    own = first.model_copy(update={"yellow": 3, "min_green": 7})
    record = NETWORK.record.model_copy(update={"intersections": (own, *others)})
    recorder = Recorder()
    for timing, times in {"both": (3, 7), "yellow": (3, 10), "min_green": (5, 7)}.items():
        found = SignalSettings(network_timing=timing)
        assert (found.yellow_at(own), found.min_green_at(own)) == times
    for told, timing in (
        ({"yellow": 4}, "min_green"),
        ({"min_green": 9}, "yellow"),
        ({"yellow": 4, "min_green": 9}, "none"),
        ({"all_red": 1}, "both"),
    ):
        assert SignalSettings(**told).network_timing == timing
        assert SignalSettings(**told, network_timing="both").network_timing == "both"
    for timing, written in {"both": True, "none": False}.items():  # by earlier versions
        assert SignalSettings(network_timing=written) == SignalSettings(network_timing=timing)
    signals = Signals(Network("own", record), SignalSettings(all_red=1), recorder.send)
    for step, wanted in enumerate([0, 1]):
        now = recorder.now = 15.0 * step
        signals.command(np.full(NETWORK.n, wanted), now)
        for moment in signals.moments:
            recorder.now = moment
            signals.clear(moment)
            signals.release(moment)
    times = {light: [time for time, _ in states] for light, states in recorder.states.items()}
    assert times[own.id] == [0, 0, 15, 18, 19]
    assert {tuple(times[node.id]) for node in others} == {(0, 0, 15, 20, 21)}


def test_a_yellow_that_gives_way_may_end_beside_the_green_it_gave_way_to():
    """Only in going on from a legal state: not against a green that is new."""
    links = NODE.links[:2]
    node = NODE.model_copy(
        update={
            "links": links,
            "foes": ((1,), (0,)),
            "yields": ((1,), ()),
            "phases": (),
            "free": (),
        }
    )
    check_state(node, "gG")
    check_state(node, "yG", "gG")
    for before in ("", "gr"):
        with pytest.raises(SignalSafetyError, match="conflict"):
            check_state(node, "yG", before)


def test_links_that_share_a_place_are_of_one_colour():
    node = NODE.model_copy(
        update={"links": NODE.links[:3], "positions": (2, 0, 2), "state_length": 4}
    )
    assert sumo_state(node, "GrG") == "rrGr"
    assert sumo_state(node, "Grg") == "rrgr"
    with pytest.raises(SignalSafetyError, match="share place 2"):
        sumo_state(node, "Grr")


def test_a_conflict_that_only_one_link_names_counts():
    first, second = next((a, b) for a, foes in enumerate(NODE.foes) for b in foes)
    for one, other in ((first, second), (second, first)):
        foes = [(other,) if link == one else () for link in range(len(NODE.links))]
        node = NODE.model_copy(update={"foes": tuple(foes), "yields": ((),) * len(NODE.links)})
        state = "".join("G" if k in (one, other) else "r" for k in range(len(NODE.links)))
        with pytest.raises(SignalSafetyError, match="conflict"):
            check_state(node, state)


@pytest.mark.parametrize(
    "change",
    [
        {"yellow": 0},
        {"min_green": -1},
        {"foes": NODE.foes[1:]},
        {"free": (len(NODE.links),)},
        {"positions": tuple(range(len(NODE.links))), "state_length": 2},
    ],
)
def test_records_of_intersections_that_cannot_be(change):
    with pytest.raises(ValidationError):
        IntersectionRecord.model_validate(NODE.model_dump() | change)
