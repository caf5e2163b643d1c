"""What is fitted to a demand, and how close to the recorded traffic the bundled profiles are."""

from collections import Counter, defaultdict
from itertools import pairwise

import numpy as np
import pytest

from tests.demand.cases import ENTRIES, GRID, HORIZON, draw, profile, to_exits
from tests.shared import CITYFLOW, needs_shared
from tsc_missing.demand.cityflow import read_flow
from tsc_missing.demand.fit import fit_profile
from tsc_missing.demand.profile import draw_demand, plain_turns, read_profile
from tsc_missing.demand.trips import Demand, Trip
from tsc_missing.network.folder import bundled_profiles
from tsc_missing.network.grid import build_grid, read_grid
from tsc_missing.paths import bundled


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


def test_entry_roads_with_few_vehicles_follow_the_course_of_the_network():
    few = [Trip(float(k), ("road_3_3_3", "road_3_2_3")) for k in range(0, 1200, 100)]
    many = [Trip(float(k // 2), ("road_0_1_0", "road_1_1_0")) for k in range(1200)]
    fitted = fit_profile(Demand.of([*few, *many]), GRID, HORIZON)
    assert fitted.arrivals["road_0_1_0"] == (600.0, 600.0, 0.0, 0.0)
    assert fitted.arrivals["road_3_3_3"] == pytest.approx((6.0, 6.0, 0.0, 0.0), abs=0.1)


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
    plain = build_grid(read_grid(bundled("networks") / name.rsplit("_", 1)[0] / "grid.toml"))
    recorded = read_flow(CITYFLOW / f"{flow}.json", plain, 3600)
    drawn = [
        draw_demand(
            read_profile(bundled_profiles()[name]),
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
