"""How the vehicles of a demand drive."""

import pytest

from tsc_missing.config import VehicleType
from tsc_missing.demand.driving import SUMO_SPEED, SUMO_TAU, driving_of
from tsc_missing.demand.trips import Demand, Trip

CAR = VehicleType(tau=2.0, max_speed=10.0)
ODD = tuple(
    f'<vType id="odd{k}" tau="{tau}" maxSpeed="{speed}"/>'
    for k, (tau, speed) in enumerate([("", "130km/h"), ("nan", "inf"), ("0", "-1")])
)
TYPES = (*ODD, '<vType id="slow" tau="3" maxSpeed="5"/>', '<vType id="plain"/>')


def trip(kind=None):
    return Trip(0.0, ("a", "b"), None if kind is None else (("type", kind),))


@pytest.mark.parametrize(
    ("trips", "tau", "speed"),
    [
        ([], 2.0, 10.0),
        ([trip()], 2.0, 10.0),
        ([trip("plain")], SUMO_TAU, SUMO_SPEED),
        ([trip("unheard of")], SUMO_TAU, SUMO_SPEED),
        ([trip("odd0"), trip("odd1"), trip("odd2")], SUMO_TAU, SUMO_SPEED),
        ([trip("slow"), trip(), trip(), trip()], (3 + 6) / 4, (5 + 30) / 4),
    ],
)
def test_it_is_the_mean_over_the_vehicles(trips, tau, speed):
    found = driving_of(Demand.of(trips, TYPES), CAR)
    assert found.tau == pytest.approx(tau)
    assert found.max_speed == pytest.approx(speed)


def test_vehicles_without_a_type_are_of_the_default_type():
    redefined = '<vType id="DEFAULT_VEHTYPE" tau="3" maxSpeed="5"/>'
    found = driving_of(Demand.of([trip(""), trip("plain")], (*TYPES, redefined)), CAR)
    assert found.tau == pytest.approx((3 + SUMO_TAU) / 2)
    assert found.max_speed == pytest.approx((5 + SUMO_SPEED) / 2)
