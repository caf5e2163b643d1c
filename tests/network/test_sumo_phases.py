"""Whatever conflicts a signal has: its phases are legal, and every movement gets green."""

from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st

from tsc_missing.network.records import IntersectionRecord, LinkRecord
from tsc_missing.network.slots import LEFT, RIGHT, STRAIGHT, slot_index
from tsc_missing.network.sumo_links import Link, Signal
from tsc_missing.network.sumo_phases import plan_phases
from tsc_missing.simulation.states import check_state, green_state


@st.composite
def signals(draw):
    """Signals of two to four roads with any conflicts between roads, settled or not."""
    links = []
    for road in range(draw(st.integers(2, 4))):
        for turn in sorted(draw(st.sets(st.sampled_from([LEFT, STRAIGHT, RIGHT]), min_size=1))):
            lane = draw(st.integers(0, 2))
            links.append(
                Link(
                    from_lane=f"r{road}_{lane}",
                    to_lane=f"x{len(links)}_0",
                    road=f"r{road}",
                    slot=slot_index(road, turn),
                    turn=turn,
                    place=len(links),
                    turns_back=turn == LEFT and draw(st.booleans()),
                    near=turn == RIGHT,
                    stopped=draw(st.booleans()),
                )
            )
    foes = [set() for _ in links]
    gives_way = [set() for _ in links]
    for i, first in enumerate(links):
        for j in range(i):
            if first.road != links[j].road and draw(st.booleans()):
                foes[i].add(j)
                foes[j].add(i)
                who = draw(st.sampled_from(["neither", "first", "second", "both"]))
                if who in ("first", "both"):
                    gives_way[i].add(j)
                if who in ("second", "both"):
                    gives_way[j].add(i)
    return Signal(
        id="s",
        place=(0.0, 0.0),
        roads={f"r{road}": road for road in range(4)},
        links=tuple(links),
        foes=tuple(map(frozenset, foes)),
        gives_way=tuple(map(frozenset, gives_way)),
        state_length=len(links),
        speed=10.0,
    )


def record(signal, plan):
    links = [
        LinkRecord(from_lane=k.from_lane, to_lane=k.to_lane, slot=k.slot) for k in signal.links
    ]
    return IntersectionRecord(
        id="s",
        x=0.0,
        y=0.0,
        roads=dict(signal.roads),
        links=tuple(links),
        foes=tuple(tuple(sorted(foes)) for foes in signal.foes),
        yields=plan.yields,
        phases=plan.phases,
        free=plan.free,
    )


@given(signal=signals(), all_phases=st.booleans())
@settings(max_examples=60)
def test_phases_are_legal_and_serve_everything(signal, all_phases):
    plan = plan_phases(signal, all_phases)
    node = record(signal, plan)
    served = set(plan.free)
    for number, phase in enumerate(plan.phases):
        check_state(node, green_state(node, number))
        served |= set(phase.links)
    assert served == set(range(len(signal.links)))
    assert len({phase.name for phase in plan.phases}) == len(plan.phases)
    for i, yields in enumerate(plan.yields):
        assert set(yields) <= signal.foes[i] & signal.gives_way[i]


@given(signal=signals())
@settings(max_examples=30)
def test_lanes_and_lamps_are_green_as_one(signal):
    links = tuple(replace(link, stopped=True) for link in signal.links)
    plan = plan_phases(replace(signal, links=links))
    assert plan.free == ()
    for phase in plan.phases:
        lanes = {links[i].from_lane for i in phase.links}
        assert {i for i, link in enumerate(links) if link.from_lane in lanes} == set(phase.links)


@given(signal=signals())
@settings(max_examples=30)
def test_straight_traffic_never_crosses_straight_traffic(signal):
    """Of different roads, if the signal stops both: whatever the junction's rules say."""
    plan = plan_phases(signal)
    straight = {i for i, k in enumerate(signal.links) if k.turn == STRAIGHT} - set(plan.free)
    for phase in plan.phases:
        green = straight & set(phase.links)
        for i in green:
            assert not signal.foes[i] & green
