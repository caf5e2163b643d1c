"""Profiles: what is drawn from them, and what is fitted to a demand."""

import json
from collections import Counter, defaultdict
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.shared import CITYFLOW, needs_shared
from tsc_missing.demand.cityflow import read_flow
from tsc_missing.demand.fit import fit_profile
from tsc_missing.demand.profile import (
    DemandProfile,
    draw_demand,
    plain_turns,
    read_profile,
    record_turns,
)
from tsc_missing.demand.trips import Demand, Trip
from tsc_missing.errors import UserError
from tsc_missing.network.grid import GridSpec, build_grid, read_grid
from tsc_missing.network.records import NetworkRecord

ROOT = Path(__file__).resolve().parents[2]
PROFILES = sorted((ROOT / "scenarios" / "demand").glob("*.json"))
GRID = build_grid(GridSpec(rows=2, columns=3, east_west=300, north_south=200))
TURNS = plain_turns(GRID)
ENTRIES = ("road_0_1_0", "road_3_3_3", "road_4_2_2")
EXITS = ("road_3_1_0", "road_1_1_3", "road_2_2_1")
HORIZON = 1200


def profile(**changes) -> DemandProfile:
    values = {
        "bin": 300,
        "irregularity": 0.4,
        "turns": (0.1, 0.6, 0.3),
        "road_turns": {"road_1_1_0": (0.0, 1.0, 0.0)},
        "exits": (),
        "arrivals": dict.fromkeys(ENTRIES, (20.0, 0.0, 31.5, 12.0)),
    }
    return DemandProfile.model_validate({**values, **changes})


def to_exits(**changes) -> DemandProfile:
    shares = {road: 1.0 + number for number, road in enumerate(EXITS)}
    return profile(exits=({"entries": ENTRIES, "exits": shares},), **changes)


def draw(drawn_from: DemandProfile, seed: int = 0, volume: float = 1.0, horizon: float = HORIZON):
    return draw_demand(drawn_from, TURNS, seed, volume, horizon)


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
    assert draw(profile()).source == "profile"


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


@pytest.mark.parametrize("seed", range(5))
def test_a_fit_finds_the_profile_that_was_drawn_from(seed):
    drawn_from = profile(arrivals=dict.fromkeys(ENTRIES, (40.0, 20.0, 30.0, 25.0)))
    fitted = fit_profile(draw(drawn_from, seed), GRID, HORIZON)
    assert fitted.arrivals == drawn_from.arrivals
    assert fitted.exits == ()
    assert fitted.turns == pytest.approx((0.1, 0.6, 0.3), abs=0.1)
    assert fitted.road_turns["road_1_1_0"] == (0.0, 1.0, 0.0)
    assert fitted.irregularity == pytest.approx(0.4, abs=0.1)


def test_a_fit_of_shortest_ways_has_exits():
    drawn_from = to_exits(arrivals=dict.fromkeys(ENTRIES, (400.0, 100.0, 200.0, 700.0)))
    fitted = fit_profile(draw(drawn_from), GRID, HORIZON)
    assert sorted(road for group in fitted.exits for road in group.entries) == sorted(ENTRIES)
    again = fit_profile(draw(fitted), GRID, HORIZON)
    for group, other in zip(fitted.exits, again.exits, strict=True):
        assert group.entries == other.entries
        assert group.exits == pytest.approx(other.exits, abs=0.05)


def test_a_fit_widens_bins_until_they_hold_enough_vehicles():
    trips = [Trip(float(k), ("road_0_1_0", "road_1_1_0")) for k in range(0, 3600, 100)]
    assert fit_profile(Demand.of(trips, "recorded"), GRID).bin == 1200


@pytest.mark.parametrize("path", PROFILES, ids=lambda path: path.stem)
def test_bundled_profiles_fit_the_bundled_networks(path):
    bundled = read_profile(path)
    folder = ROOT / "networks" / path.stem.rsplit("_", 1)[0]
    record = NetworkRecord.model_validate_json((folder / "network.json").read_text())
    plain = build_grid(read_grid(folder / "grid.toml"))
    assert record_turns(record) == plain_turns(plain)
    demand = draw_demand(bundled, record_turns(record), 0, 1.0, 3600)
    assert len(demand.trips) == sum(sum(row) for row in bundled.arrivals.values())
    assert all(sum(row) >= 10 * len(row) for row in bundled.arrivals.values())


@needs_shared
@pytest.mark.parametrize(
    ("name", "flow"),
    [
        ("hangzhou_1", "anon_4_4_hangzhou_real"),
        ("jinan_1", "anon_3_4_jinan_real"),
        ("newyork_1", "anon_16_3_newyork_real"),
    ],
)
def test_bundled_profiles_send_traffic_where_the_recorded_went(name, flow):
    plain = build_grid(read_grid(ROOT / "networks" / name.rsplit("_", 1)[0] / "grid.toml"))
    recorded = read_flow(CITYFLOW / f"{flow}.json", plain, 3600)
    drawn = [
        draw_demand(
            read_profile(ROOT / "scenarios" / "demand" / f"{name}.json"),
            plain_turns(plain),
            seed,
            1.0,
            3600,
        )
        for seed in range(10)
    ]
    length = np.mean([len(trip.route) for trip in recorded.trips])
    assert np.mean([len(t.route) for d in drawn for t in d.trips]) == pytest.approx(
        length, rel=0.03
    )
    wanted, made = turn_volumes([recorded]), turn_volumes(drawn)
    missed = sum(abs(made[pair] - wanted[pair]) for pair in {*wanted, *made})
    assert missed < 0.08 * sum(wanted.values())


def turn_volumes(demands: list[Demand]) -> dict[tuple[str, str], float]:
    """The vehicles that make each turn, on average."""
    counts = Counter(pair for d in demands for trip in d.trips for pair in pairwise(trip.route))
    return defaultdict(float, {pair: n / len(demands) for pair, n in counts.items()})
