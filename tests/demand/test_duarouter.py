"""What of SUMO's route files becomes demand, and what is said of the rest."""

import pytest

from tests.sumo_files import star, write_routes
from tsc_missing.demand.duarouter import route_demand

HORIZON = 120.0
TRIP = '<trip id="t" depart="1" from="in_0" to="out_2"/>'


@pytest.fixture(scope="module")
def net(tmp_path_factory):
    return star(tmp_path_factory.mktemp("star"), (0, 90, 180, 270), 2)


@pytest.fixture
def demand_of(net, tmp_path):
    """The demand of a route file with these elements."""

    def found(*elements, begin=0.0):
        path = write_routes(tmp_path / "cars.rou.xml", *elements)
        return route_demand(net, [path], begin, HORIZON, 0, "routes")

    return found


def names(found):
    return [trip.name for trip in found.demand.trips]


def test_a_default_type_of_its_own_is_kept(demand_of):
    (kind,) = demand_of('<vType id="DEFAULT_VEHTYPE" length="9"/>', TRIP).demand.types
    assert 'id="DEFAULT_VEHTYPE"' in kind
    assert 'length="9' in kind
