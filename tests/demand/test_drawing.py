"""What is drawn from a profile: possible trips, in the numbers and ways that it says."""

import json
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.demand.cases import ENTRIES, EXITS, TURNS, draw, profile, to_exits
from tsc_missing.demand.profile import read_profile
from tsc_missing.errors import UserError

shares = st.tuples(*[st.floats(0.01, 1.0)] * 3)
profiles = st.builds(
    lambda directed, **values: (to_exits if directed else profile)(**values),
    directed=st.booleans(),
    bin=st.integers(1, 600),
    irregularity=st.floats(0, 1),
    turns=shares,
    road_turns=st.dictionaries(st.sampled_from(sorted(TURNS)), shares),
    arrivals=st.fixed_dictionaries(dict.fromkeys(ENTRIES, st.tuples(*[st.floats(0, 40)] * 3))),
)


@given(profiles, st.integers(0, 2**32), st.floats(0.1, 3), st.integers(1, 2000))
def test_every_trip_is_possible(drawn_from, seed, volume, horizon):
    demand = draw(drawn_from, seed, volume, horizon)
    departs = [trip.depart for trip in demand.trips]
    assert departs == sorted(departs)
    assert all(0 <= t < min(horizon, 3 * drawn_from.bin) and t == int(t) for t in departs)
    for trip in demand.trips:
        assert trip.route[0] in ENTRIES
        assert len(set(trip.route)) == len(trip.route)
        assert all(after in TURNS[before] for before, after in pairwise(trip.route))
        assert not drawn_from.exits or trip.route[-1] in EXITS


@given(profiles, st.integers(0, 2**32))
def test_the_same_seed_draws_the_same_trips(drawn_from, seed):
    assert draw(drawn_from, seed) == draw(drawn_from, seed)


def test_another_seed_draws_other_trips():
    assert draw(profile(), 0) != draw(profile(), 1)


@pytest.mark.parametrize("volume", [0.3, 1.0, 1.7])
def test_volume_scales_the_arrivals(volume):
    cells = Counter()
    for seed in range(200):
        trips = draw(profile(), seed, volume).trips
        cells.update((trip.route[0], int(trip.depart // 300)) for trip in trips)
        assert abs(len(trips) - volume * 3 * 63.5) <= 3 * 3
    for road in ENTRIES:
        for number, expected in enumerate((20.0, 0.0, 31.5, 12.0)):
            mean = cells[road, number] / 200
            assert mean == pytest.approx(volume * expected, abs=4 * 0.5 / np.sqrt(200))


@pytest.mark.parametrize("irregularity", [0.0, 0.5, 1.0])
def test_irregularity_is_the_variation_of_the_headways(irregularity):
    even = profile(bin=3600, irregularity=irregularity, arrivals={ENTRIES[0]: (200.0,)})
    gaps = [
        np.diff([trip.depart for trip in draw(even, seed, horizon=3600).trips])
        for seed in range(30)
    ]
    variation = np.concatenate(gaps).std() / 18.0
    assert variation == pytest.approx(irregularity, abs=0.05)


def test_turns_follow_the_shares():
    crowd = profile(arrivals={ENTRIES[0]: (9000.0,)})
    first = Counter(trip.route[1] for trip in draw(crowd).trips)
    second = Counter(trip.route[2] for trip in draw(crowd).trips if trip.route[1] == "road_1_1_0")
    made = {turn: first[road] / 9000 for road, turn in TURNS[ENTRIES[0]].items()}
    assert [made[turn] for turn in range(3)] == pytest.approx([0.1, 0.6, 0.3], abs=0.02)
    assert set(second) == {"road_2_1_0"}


def test_walks_end_where_the_network_does_or_before_a_road_they_used():
    for trip in draw(profile(turns=(0.1, 0.1, 0.8), road_turns={})).trips:
        onward = TURNS.get(trip.route[-1], {})
        assert not onward or set(onward) & set(trip.route)


def test_ways_to_exits_are_the_shortest_that_are_open():
    for trip in draw(to_exits(road_turns={})).trips:
        if (trip.route[0], trip.route[-1]) == ("road_0_1_0", "road_3_1_0"):
            assert len(trip.route) == 4
    closed = to_exits(road_turns={"road_1_1_0": (1.0, 0.0, 0.0)})
    long = {
        len(trip.route)
        for trip in draw(closed).trips
        if (trip.route[0], trip.route[-1]) == ("road_0_1_0", "road_3_1_0")
    }
    assert long == {6}


def test_nobody_leaves_where_he_entered():
    back = profile(exits=({"entries": ENTRIES, "exits": {"road_1_1_2": 0.9, "road_3_1_0": 0.1}},))
    ways = Counter((trip.route[0], trip.route[-1]) for trip in draw(back).trips)
    assert ways["road_0_1_0", "road_1_1_2"] == 0
    assert ways["road_4_2_2", "road_1_1_2"] > 0


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        (profile(arrivals={"road_9_9_0": (1.0,)}), "road_9_9_0"),
        (profile(arrivals={"road_1_1_2": (1.0,)}), "road_1_1_2"),
        (
            profile(
                exits=({"entries": ["road_0_1_0"], "exits": {"nowhere": 1.0}},),
                arrivals={"road_0_1_0": (1.0,)},
            ),
            "nowhere",
        ),
        (
            profile(
                exits=({"entries": ["road_0_1_0"], "exits": {"road_1_1_2": 1.0}},),
                arrivals={"road_0_1_0": (1.0,)},
            ),
            "road_0_1_0",
        ),
    ],
)
def test_roads_that_do_not_fit_the_network_are_named(wrong, named):
    with pytest.raises(UserError, match=named):
        draw(wrong)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"arrivals": {}}, "number of bins"),
        ({"arrivals": {"a": [1.0], "b": [1.0, 2.0]}}, "number of bins"),
        ({"arrivals": {"a": [-1.0]}}, "at arrivals"),
        ({"turns": [0, 0, 0]}, "must not all be 0"),
        ({"exits": [{"entries": ["a"], "exits": {"x": 1.0}}]}, "one group"),
        ({"seed": 1}, "at seed"),
    ],
)
def test_what_is_wrong_with_a_file_is_named(tmp_path, changes, words):
    path = tmp_path / "profile.json"
    path.write_text(json.dumps({**profile().model_dump(mode="json"), **changes}))
    with pytest.raises(UserError, match=words):
        read_profile(path)
