"""Bundled profiles: what is drawn from them is valid, repeatable and of the right size."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.shared import CITYFLOW, needs_shared
from tsc_missing.demand.cityflow import read_flow
from tsc_missing.demand.fit import fit_profile
from tsc_missing.demand.profile import draw_demand, read_profile, record_turns
from tsc_missing.errors import UserError
from tsc_missing.network.cityflow import read_roadnet
from tsc_missing.network.folder import bundled_profiles, read_folder
from tsc_missing.network.grid import build_grid, read_grid
from tsc_missing.paths import bundled

PROFILES = bundled_profiles()
CITY = {name: name.rsplit("_", 1)[0] for name in PROFILES}
TURNS = {
    city: record_turns(read_folder(bundled("networks") / city, city).network.record)
    for city in set(CITY.values())
}
ROADNETS = {"jinan": "roadnet_3_4", "hangzhou": "roadnet_4_4", "newyork": "roadnet_16_3"}


def draw(name, seed=0, volume=1.0, horizon=3600):
    return draw_demand(read_profile(PROFILES[name]), TURNS[CITY[name]], seed, volume, horizon)


def test_all_six_datasets_are_bundled():
    assert sorted(PROFILES) == [
        "hangzhou_1",
        "hangzhou_2",
        "jinan_1",
        "jinan_2",
        "jinan_3",
        "newyork_1",
    ]


@pytest.mark.parametrize("name", PROFILES)
@given(seed=st.integers(0, 2**31), volume=st.floats(0.3, 1.5), horizon=st.integers(60, 3600))
@settings(max_examples=5)
def test_drawn_trips_are_valid(name, seed, volume, horizon):
    trips = draw(name, seed, volume, horizon).trips
    departures = [trip.depart for trip in trips]
    assert departures == sorted(departures)
    assert all(0 <= depart < horizon for depart in departures)
    turns = TURNS[CITY[name]]
    for trip in trips:
        assert len(set(trip.route)) == len(trip.route)
        assert all(b in turns[a] for a, b in itertools.pairwise(trip.route))


@pytest.mark.parametrize(
    ("name", "vehicles"),
    [("hangzhou_1", 2983), ("hangzhou_2", 6984), ("jinan_1", 6295), ("newyork_1", 2824)],
)
def test_the_volume_is_that_of_the_recorded_flow(name, vehicles):
    assert len(draw(name).trips) == pytest.approx(vehicles, rel=0.01)
    assert len(draw(name, volume=0.6).trips) == pytest.approx(0.6 * vehicles, rel=0.02)


def test_same_seed_same_trips_other_seed_others():
    assert draw("jinan_1", 3) == draw("jinan_1", 3)
    assert draw("jinan_1", 3) != draw("jinan_1", 4)


def test_turn_shares_are_those_of_the_profile():
    turns = TURNS["jinan"]
    counts = np.zeros(3)
    for trip in draw("jinan_1").trips:
        for a, b in itertools.pairwise(trip.route):
            counts[turns[a][b]] += 1
    np.testing.assert_allclose(counts / counts.sum(), [0.144, 0.575, 0.282], atol=0.02)


def test_an_entry_road_that_is_not_there_is_named():
    profile = read_profile(PROFILES["jinan_1"])
    wrong = profile.model_copy(update={"arrivals": {"road_9_9_9": (1.0,) * 12}})
    with pytest.raises(UserError, match="road_9_9_9"):
        draw_demand(wrong, TURNS["jinan"], 0, 1.0, 3600)


@needs_shared
def test_bundled_profiles_are_the_fit_of_the_recorded_flows():
    plain = build_grid(read_grid(bundled("networks") / "jinan" / "grid.toml"))
    demand = read_flow(CITYFLOW / "anon_3_4_jinan_real_2000.json", plain, 3600)
    assert fit_profile(demand, plain) == read_profile(PROFILES["jinan_2"])


@needs_shared
@pytest.mark.parametrize("city", ROADNETS)
def test_grids_are_the_recorded_networks(city):
    ours = build_grid(read_grid(bundled("networks") / city / "grid.toml"))
    recorded = read_roadnet(CITYFLOW / f"{ROADNETS[city]}.json")
    assert set(ours.roads) == set(recorded.roads)
    for name, road in recorded.roads.items():
        assert ours.roads[name].lanes == road.lanes
        assert ours.roads[name].shape == road.shape
    assert set(ours.nodes) == set(recorded.nodes)
    for name, node in recorded.nodes.items():
        mine = ours.nodes[name]
        assert (mine.x, mine.y, mine.signalised) == (node.x, node.y, node.signalised)
        assert set(mine.movements) == set(node.movements)
        for one, other in zip(mine.phases, node.phases, strict=True):
            assert {mine.movements[k] for k in one.movements} == {
                node.movements[k] for k in other.movements
            }
