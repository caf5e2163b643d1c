"""Generated demand: so many vehicles an hour, a course over time, and where they go."""

import math
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal
from xml.sax.saxutils import quoteattr

import numpy as np
from pydantic import Field, model_validator

from tsc_missing.config import Settings, VehicleType
from tsc_missing.demand.duarouter import Found, route_demand
from tsc_missing.demand.profile import DemandProfile, ExitShares, draw_demand, possible_exits
from tsc_missing.demand.routing import FloatArray, RoadGraph, Turns
from tsc_missing.demand.trips import Demand, Trip
from tsc_missing.errors import UserError
from tsc_missing.network.slots import STRAIGHT
from tsc_missing.network.sumo_links import TURN_OF_DIRECTION
from tsc_missing.seeding import stream

BIN = 300  # [s]
INSIDE = 100  # roads inside a map, at most, that traffic starts from and goes to
SPREAD = 1 / 6  # of the horizon: the standard deviation of the course gaussian
BARELY = 1e-3  # weight of a turn that is only made where nothing else is possible

Course = Literal["constant", "peak", "ramp", "gaussian"]


class DemandSpec(Settings):
    """How much traffic there is and when; the course has a mean of 1 over the horizon.

    ``through``: on a grid the share of vehicles that never turn; the others turn by ``turns``
    (left, straight, right) at every intersection. On a map the share that only passes through; of
    the others half start and half end inside it.
    """

    vehicles_per_hour: float = Field(gt=0, le=1e6)  # in the whole network
    course: Course = "constant"
    turns: tuple[float, float, float] = (0.1, 0.6, 0.3)
    through: float = Field(0.0, ge=0, le=1)
    irregularity: float = Field(1.0, ge=0, le=1)  # of headways

    @model_validator(mode="after")
    def _turns_are_shares(self) -> "DemandSpec":
        if min(self.turns) < 0 or not 0 < sum(self.turns) < math.inf:
            raise ValueError("the turn shares must be numbers from 0 on, not all 0")
        return self


def course_over_time(course: Course, horizon: float) -> FloatArray:
    """The rate of arrivals in each bin of 300 s, relative to the mean over the horizon.

    ``peak`` is four times as high in the middle third as outside it, ``ramp`` rises from 0,
    ``gaussian`` is a bell around the middle.
    """
    times = np.minimum(np.arange(math.ceil(horizon / BIN) + 1) * BIN, horizon)
    bounds = times / horizon
    middle = (bounds[:-1] + bounds[1:]) / 2
    shape: FloatArray = {
        "constant": np.ones_like(middle),
        "peak": np.where(np.abs(middle - 0.5) <= 1 / 6, 2.0, 0.5),
        "ramp": 2 * middle,
        "gaussian": np.exp(-0.5 * ((middle - 0.5) / SPREAD) ** 2),
    }[course]
    relative: FloatArray = shape / np.average(shape, weights=np.diff(times) / BIN)
    return relative


def arrivals_by_road(
    spec: DemandSpec, weights: Mapping[str, float], horizon: float
) -> dict[str, tuple[float, ...]]:
    """Vehicles that enter by each road in each bin, in proportion to the roads' weights.

    Of the last bin as if it were a whole one: what departs after the horizon is not drawn.
    """
    total = sum(weights.values())
    in_bins = spec.vehicles_per_hour * BIN / 3600.0 * course_over_time(spec.course, horizon)
    return {
        road: tuple((in_bins * weight / total).round(6).tolist())
        for road, weight in weights.items()
    }


def generate_on_grid(
    turns: Turns, weights: Mapping[str, float], spec: DemandSpec, horizon: float, seed: int
) -> Demand:
    """Trips that enter by the roads of ``weights`` and turn at random until they leave."""
    straight_on = (BARELY, 1.0, BARELY)
    seeds = stream(seed, "generate").integers(2**31, size=2).tolist()
    trips: list[Trip] = []
    for share, shares, drawn in (
        (1 - spec.through, spec.turns, seeds[0]),
        (spec.through, straight_on, seeds[1]),
    ):
        if share > 0:
            profile = _profile(spec, arrivals_by_road(spec, weights, horizon), shares, ())
            trips += draw_demand(profile, turns, drawn, share, horizon).trips
    return Demand.of(trips)


def too_few(spec: DemandSpec, horizon: float) -> UserError:
    """The error for a demand of which no vehicle was drawn within ``horizon`` [s]."""
    words = f"so few that none enters in {horizon:g} s; give more, or a longer --horizon"
    return UserError("vehicles-per-hour", f"{spec.vehicles_per_hour:g}", words)


def _profile(
    spec: DemandSpec,
    arrivals: dict[str, tuple[float, ...]],
    turns: tuple[float, float, float],
    exits: tuple[ExitShares, ...],
) -> DemandProfile:
    return DemandProfile(
        bin=BIN,
        irregularity=spec.irregularity,
        turns=turns,
        road_turns={},
        exits=exits,
        arrivals=arrivals,
    )


def entry_warnings(
    arrivals: Mapping[str, Sequence[float]],
    lanes: Mapping[str, Sequence[float]],
    vehicle: VehicleType,
) -> list[str]:
    """Where more vehicles want to enter than a road's lanes take, in words.

    ``lanes`` are the speed limits [m/s] of each road's lanes. A lane takes a vehicle every
    ``tau + (length + min_gap) / speed`` seconds.
    """
    found = []
    for road, row in arrivals.items():
        wanted = max(row) * 3600.0 / BIN
        space = vehicle.spacing
        takes = sum(
            3600.0 / (vehicle.tau + space / min(speed, vehicle.max_speed)) for speed in lanes[road]
        )
        if wanted > takes:
            found.append(
                f"{road}: up to {wanted:.0f} vehicles/h want to enter, its {len(lanes[road])} "
                f"lanes take {takes:.0f}"
            )
    return found


def generate_through_net(
    net: Any, net_file: Path, spec: DemandSpec, begin: float, horizon: float, seed: int
) -> Found:
    """Trips through a map: from road to road, by the fastest ways of the empty network.

    Roads at the map's edge have weights by lanes and speed, roads inside by length. Raises
    ``UserError`` where no road leads to another, or no vehicle is drawn.
    """
    roads = {edge.getID(): edge for edge in net.getEdges() if edge.allows("passenger")}
    turns = _turns(roads)
    rng = stream(seed, "places")
    edge_in = {k: _size(e) for k, e in roads.items() if e.is_fringe(e.getIncoming())}
    edge_out = {k: _size(e) for k, e in roads.items() if e.is_fringe(e.getOutgoing())}
    inner = sorted(set(roads) - set(edge_in) - set(edge_out))
    chosen = sorted(rng.choice(inner, min(INSIDE, len(inner)), replace=False).tolist())
    inside = {k: float(roads[k].getLength()) for k in chosen}
    through = spec.through if inside else 1.0
    parts = [
        (through, edge_in, edge_out),
        ((1 - through) / 2, edge_in, inside),
        ((1 - through) / 2, inside, edge_out),
    ]
    if not edge_in or not edge_out:
        parts = [(1.0, inside, inside)]
    trips: list[Trip] = []
    seeds = rng.integers(2**31, size=len(parts)).tolist()
    totals: dict[str, FloatArray] = {}
    for (share, starts, ends), drawn in zip(parts, seeds, strict=True):
        starts, ends = _connected(turns, starts, ends)
        if share > 0 and starts:
            arrivals = arrivals_by_road(spec, starts, horizon)
            exits = (ExitShares(entries=tuple(starts), exits=ends),)
            profile = _profile(spec, arrivals, (1.0, 1.0, 1.0), exits)
            trips += draw_demand(profile, turns, drawn, share, horizon).trips
            for road, row in arrivals.items():
                totals[road] = totals.get(road, np.zeros(len(row))) + share * np.array(row)
    if not totals:
        raise UserError(
            "vehicles-per-hour", spec.vehicles_per_hour, "no road of the net leads to another"
        )
    if not trips:
        raise too_few(spec, horizon)
    speeds = {k: [lane.getSpeed() for lane in _car_lanes(roads[k])] for k in totals}
    arrivals = {road: row.tolist() for road, row in totals.items()}
    warnings = [f"warning: {w}" for w in entry_warnings(arrivals, speeds, VehicleType())]
    found = _fastest(Demand.of(trips), net_file, begin, horizon, seed)
    return Found(found.demand, (*warnings, *found.notes))


def _size(edge: Any) -> float:
    return float(len(_car_lanes(edge)) * edge.getSpeed())


def _car_lanes(edge: Any) -> list[Any]:
    return [lane for lane in edge.getLanes() if lane.allows("passenger")]


def _turns(roads: Mapping[str, Any]) -> dict[str, dict[str, int]]:
    return {
        name: {
            after.getID(): TURN_OF_DIRECTION.get(connections[0].getDirection(), STRAIGHT)
            for after, connections in sorted(
                edge.getOutgoing().items(), key=lambda item: str(item[0].getID())
            )
            if after.getID() in roads
        }
        for name, edge in sorted(roads.items())
    }


def _connected(
    turns: Turns, starts: Mapping[str, float], ends: Mapping[str, float]
) -> tuple[dict[str, float], dict[str, float]]:
    """The starts from which some end can be reached, and the ends."""
    graph = RoadGraph.of(turns, lambda road: (1.0, 1.0, 1.0))
    first, last = sorted(k for k in starts if turns.get(k)), sorted(ends)
    if not first or not last:
        return {}, {}
    possible = possible_exits(graph, graph.numbers(first), graph.numbers(last))
    reachable = {k: starts[k] for k, row in zip(first, possible, strict=True) if row.any()}
    return reachable, {k: ends[k] for k in last}


def _fastest(demand: Demand, net: Path, begin: float, horizon: float, seed: int) -> Found:
    """The same trips from road to road, by the fastest ways, as the run's own car."""
    lines = [
        f'<trip id="{number}" depart="{begin + trip.depart:.2f}" from={quoteattr(trip.route[0])} '
        f"to={quoteattr(trip.route[-1])}/>"
        for number, trip in enumerate(demand.trips)
    ]
    with tempfile.TemporaryDirectory(prefix="tsc-") as scratch:
        path = Path(scratch, "generated.rou.xml")
        path.write_text("\n".join(["<routes>", *lines, "</routes>"]), encoding="utf-8")
        found = route_demand(net, [path], begin, horizon, seed, "vehicles-per-hour")
    trips = (Trip(trip.depart, trip.route) for trip in found.demand.trips)
    return Found(Demand.of(trips), found.notes)
