import xml.etree.ElementTree as ET

import pytest

from tests.controllers.helpers import cross_and_tee
from tests.networks import grid_network, tee_network
from tsc_missing.config import SignalSettings
from tsc_missing.network.model import Network
from tsc_missing.simulation.native import KINDS, PROGRAM_ID, native_program_xml
from tsc_missing.simulation.states import check_state, green_state, red_state, yellow_state


def programs(network: Network, kind: str, signals: SignalSettings) -> list[ET.Element]:
    return list(
        ET.fromstring(f"<additional>{native_program_xml(network, kind, signals)}</additional>")
    )


@pytest.mark.parametrize("kind", KINDS)
def test_one_program_an_intersection_with_its_phases_in_order(kind):
    network = cross_and_tee()
    logics = programs(network, kind, SignalSettings())
    assert [logic.get("id") for logic in logics] == ["A", "B"]
    assert {(logic.get("type"), logic.get("programID")) for logic in logics} == {(kind, PROGRAM_ID)}
    for node, logic in zip(network.intersections, logics, strict=True):
        greens = [phase.attrib for phase in logic if "minDur" in phase.attrib]
        assert [g["state"] for g in greens] == [green_state(node, p) for p in range(len(greens))]
        assert {(g["minDur"], g["maxDur"]) for g in greens} == {("10", "50")}
        assert len(greens) == len(node.phases)


def test_yellow_and_all_red_between_phases_and_after_the_last():
    network = cross_and_tee()
    node = network.intersections[0]
    logic = programs(network, "actuated", SignalSettings(yellow=3, all_red=2))[0]
    greens = [green_state(node, phase) for phase in range(4)]
    expected = []
    for before, after in zip(greens, [*greens[1:], greens[0]], strict=True):
        expected += [
            ("10", before),
            ("3", yellow_state(before, after)),
            ("2", red_state(before, after)),
        ]
    assert [(phase.get("duration"), phase.get("state")) for phase in logic] == expected
    for _, state in expected:
        assert "r" not in [state[link] for link in node.free]


def test_a_minimum_green_longer_than_the_usual_longest():
    signals = SignalSettings(decision_interval=90, min_green=60)
    logic = programs(cross_and_tee(), "delay_based", signals)[0]
    assert (logic[0].get("minDur"), logic[0].get("maxDur")) == ("60", "60")


@pytest.mark.parametrize("build", [tee_network, lambda: grid_network(1, 1)])
def test_every_state_is_legal(build):
    network = build()
    logics = programs(network, "actuated", SignalSettings(all_red=1))
    for node, logic in zip(network.intersections, logics, strict=True):
        for phase in logic:
            check_state(node, phase.attrib["state"])
