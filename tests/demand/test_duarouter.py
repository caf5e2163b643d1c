"""What of SUMO's route files becomes demand, and what is said of the rest."""

import pytest

from tests.sumo_files import star, write_routes
from tsc_missing.demand.duarouter import route_demand
from tsc_missing.demand.sumo import read_routes
from tsc_missing.errors import UserError

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


def test_flows_in_intervals_have_their_times(demand_of):
    flow = '<flow id="f" number="10" from="in_0" to="out_2"/>'
    rate = '<flow id="g" number="3" period="10" from="in_1" to="out_3"/>'
    found = demand_of(f'<interval begin="20" end="70">{flow}{rate}</interval>', TRIP)
    departs = [trip.depart for trip in found.demand.trips if trip.name.startswith("f")]
    assert departs == list(range(20, 70, 5))
    departs = [trip.depart for trip in found.demand.trips if trip.name.startswith("g")]
    assert departs == [20, 30, 40]
    assert found.notes == ()


def test_included_files_are_read(demand_of, tmp_path):
    (tmp_path / "sub").mkdir()
    write_routes(tmp_path / "sub" / "more.rou.xml", TRIP.replace('"t"', '"u"'))
    include = '<include href="sub/more.rou.xml"/>'
    assert set(names(demand_of(include, TRIP))) == {"t", "u"}
    with pytest.raises(UserError, match=r"none\.rou\.xml.*cannot be read"):
        demand_of('<include href="none.rou.xml"/>', TRIP)
    with pytest.raises(UserError, match="includes itself"):
        demand_of('<include href="cars.rou.xml"/>', TRIP)


def test_elements_that_are_not_read_are_noted(demand_of):
    assert demand_of(TRIP, "<poi/>", "<poi/>").notes == ("left out: 2 poi elements",)


@pytest.mark.parametrize("when", ["triggered", "containerTriggered", "split", "soon", "nan"])
def test_vehicles_that_no_time_starts_are_left_out_and_counted(demand_of, when):
    other = TRIP.replace('"t"', '"x"').replace('depart="1"', f'depart="{when}"')
    found = demand_of(TRIP, other)
    assert names(found) == ["t"]
    assert found.notes == ("left out: 1 vehicle that no time starts, first x",)
    with pytest.raises(UserError, match="no vehicle, trip or flow that a time starts"):
        demand_of(other)


def test_the_departure_begin_is_that_of_the_run(demand_of):
    found = demand_of(TRIP.replace('depart="1"', 'depart="begin"'), begin=500.0)
    assert [trip.depart for trip in found.demand.trips] == [0.0]


def test_scaled_types_are_refused(demand_of):
    trip = TRIP.replace('id="t"', 'id="t" type="k"')
    assert names(demand_of('<vType id="k" scale="1.0"/>', trip)) == ["t"]
    nested = '<vTypeDistribution id="k"><vType id="a" scale="2"/></vTypeDistribution>'
    for kind in ('<vType id="k" scale="0.5"/>', nested):
        with pytest.raises(UserError, match=r"vType \w has a scale of .*; only 1 is read"):
            demand_of(kind, trip)


def test_a_scaled_type_of_a_folder_is_refused_before_the_run(tmp_path):
    vehicle = '<vehicle id="t" type="k" depart="1"><route edges="in_0 out_2"/></vehicle>'
    path = write_routes(tmp_path / "cars.rou.xml", '<vType id="k" scale="2"/>', vehicle)
    with pytest.raises(UserError, match="vType k has a scale of 2"):
        read_routes(path, HORIZON)


def test_a_type_that_is_not_there_is_named(demand_of):
    """The run would fail, also if other vehicles have a type."""
    bus = TRIP.replace('id="t"', 'id="u" type="bus"')
    with pytest.raises(UserError, match="it has vehicles of type bus, which no vType"):
        demand_of(TRIP, bus)
    assert len(names(demand_of(TRIP, bus.replace("bus", "DEFAULT_TAXITYPE")))) == 2
    nested = '<vTypeDistribution id="d"><vType id="bus"/></vTypeDistribution>'
    assert (
        len(names(demand_of(nested, TRIP, bus, bus.replace('"bus"', '"d"').replace('"u"', '"w"'))))
        == 3
    )


def test_trips_between_zones(demand_of):
    trip = '<trip id="z" depart="2" fromTaz="1" toTaz="2"/>'
    zones = '<taz id="1" edges="in_1"/>', '<tazs><taz id="2" edges="out_3"/></tazs>'
    (found,) = demand_of(*zones, trip).demand.trips
    assert found.route == ("in_1", "out_3")
    assert found.attributes == ()
    with pytest.raises(UserError, match="between TAZ; give the file with the taz 2"):
        demand_of(zones[0], trip)


def test_roads_beside_zones_need_no_zones(demand_of):
    """As od2trips writes them, and duarouter."""
    both = TRIP.replace("from=", 'fromTaz="1" toTaz="2" from=')
    route = '<route edges="in_1 out_3" probability="1"/>'
    routed = f'<vehicle id="r" depart="2" fromTaz="1" toTaz="2">{route}</vehicle>'
    several = routed.replace(route, f"<routeDistribution>{route}</routeDistribution>")
    found = demand_of(both, routed, several.replace('"r"', '"s"'))
    routes = [trip.route for trip in found.demand.trips]
    assert routes == [("in_0", "out_2"), ("in_1", "out_3"), ("in_1", "out_3")]
    assert found.notes == ()
