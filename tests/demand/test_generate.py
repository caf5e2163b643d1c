"""Generated demand: its course, its amount, and where it cannot enter."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsc_missing.config import VehicleType
from tsc_missing.demand.generate import (
    BIN,
    DemandSpec,
    arrivals_by_road,
    course_over_time,
    entry_warnings,
    generate_on_grid,
)
from tsc_missing.demand.profile import plain_turns
from tsc_missing.network.grid import GridSpec, build_grid

TURNS = plain_turns(build_grid(GridSpec(rows=2, columns=3, east_west=200, north_south=200)))
COURSES = ("constant", "peak", "ramp", "gaussian")


@given(course=st.sampled_from(COURSES), horizon=st.integers(1, 20000))
def test_every_course_has_a_mean_of_one(course, horizon):
    shape = course_over_time(course, horizon)
    lengths = [min(BIN, horizon - start) for start in range(0, horizon, BIN)]
    assert np.average(shape, weights=lengths) == pytest.approx(1.0)
    assert (shape >= 0).all()


@given(
    course=st.sampled_from(COURSES),
    horizon=st.integers(60, 1500),
    irregularity=st.sampled_from([0.0, 1.0]),
)
def test_as_many_are_drawn_as_were_asked_for(course, horizon, irregularity):
    spec = DemandSpec(vehicles_per_hour=36_000, course=course, irregularity=irregularity)
    wanted = 36_000 * horizon / 3600
    trips = generate_on_grid(TURNS, {"road_0_1_0": 3.0, "road_2_0_1": 3.0}, spec, horizon, 1).trips
    assert len(trips) == pytest.approx(wanted, abs=3 + 4 * wanted**0.5)


def test_the_shapes_of_the_courses():
    assert np.ptp(course_over_time("constant", 3600)) == 0
    assert (np.diff(course_over_time("ramp", 3600)) > 0).all()
    bell = course_over_time("gaussian", 3600)
    assert bell == pytest.approx(bell[::-1])
    assert bell.argmax() in (5, 6)
    peak = course_over_time("peak", 3600)
    assert peak[4:8].min() == pytest.approx(4 * peak[0])


@given(st.dictionaries(st.text("abc", min_size=1), st.floats(0.5, 8), min_size=1, max_size=5))
def test_arrivals_add_up_to_what_was_asked_for(weights):
    arrivals = arrivals_by_road(DemandSpec(vehicles_per_hour=1800, course="peak"), weights, 3600)
    assert sum(map(sum, arrivals.values())) == pytest.approx(1800, abs=1e-3)


def test_through_traffic_goes_straight_on():
    entries = {"road_0_1_0": 3.0, "road_2_0_1": 3.0}
    spec = DemandSpec(vehicles_per_hour=600, through=1.0)
    trips = generate_on_grid(TURNS, entries, spec, 1800, 1).trips
    assert len(trips) == pytest.approx(300, abs=15)
    straight = [{TURNS[a][b] for a, b in zip(t.route, t.route[1:], strict=False)} for t in trips]
    assert sum(made == {1} for made in straight) > 0.95 * len(trips)
    assert trips == generate_on_grid(TURNS, entries, spec, 1800, 1).trips
    assert trips != generate_on_grid(TURNS, entries, spec, 1800, 2).trips


def test_lanes_take_a_vehicle_every_headway():
    vehicle = VehicleType()
    takes = 3600 / (vehicle.tau + 7.5 / 11.111) * BIN / 3600
    lanes = {"a": [11.111], "b": [11.111, 11.111]}
    assert entry_warnings({"a": [takes - 1], "b": [2 * takes - 1]}, lanes, vehicle) == []
    (warning,) = entry_warnings({"a": [0, takes + 1], "b": [takes + 1]}, lanes, vehicle)
    assert warning.startswith("a: up to ")
    assert "1346" in warning
