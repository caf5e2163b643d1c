"""CityFlow flow files as trips."""

import math
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, Field, TypeAdapter

from tsc_missing.config import VehicleType
from tsc_missing.demand.trips import Demand, Trip
from tsc_missing.errors import UserError
from tsc_missing.files import parse, read_json
from tsc_missing.network.plain import PlainNetwork

FIELD = "flow"

Time = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class _Flow(BaseModel):
    route: list[str] = Field(min_length=1)
    interval: float = Field(default=1.0, gt=0, allow_inf_nan=False)
    startTime: Time
    endTime: Annotated[float, Field(ge=-1, allow_inf_nan=False)]
    vehicle: dict[str, object] = {}


_ADAPTER = TypeAdapter(list[_Flow])


def read_flow(path: Path, network: PlainNetwork, horizon: float) -> Demand:
    """The trips of a CityFlow flow file that depart before ``horizon`` [s].

    An entry is a vehicle every ``interval`` seconds from ``startTime`` up to ``endTime`` (-1: to
    the horizon). Raises ``UserError`` for roads that are not in the network and for routes whose
    roads are not connected.
    """
    connected = {
        (move.from_road, move.to_road) for node in network.nodes.values() for move in node.movements
    }
    trips = []
    for number, flow in enumerate(_flows(path)):
        unknown = next((road for road in flow.route if road not in network.roads), None)
        if unknown is not None:
            raise UserError(FIELD, path, f"entry {number}: unknown road {unknown}")
        for pair in zip(flow.route, flow.route[1:], strict=False):
            if pair not in connected:
                raise UserError(
                    FIELD, path, f"entry {number}: no movement leads from {pair[0]} to {pair[1]}"
                )
        if flow.endTime != -1 and flow.endTime < flow.startTime:
            raise UserError(
                FIELD,
                path,
                f"entry {number}: endTime {flow.endTime:g} is before startTime {flow.startTime:g}",
            )
        last = horizon if flow.endTime == -1 else min(flow.endTime, horizon)
        count = math.floor((last - flow.startTime) / flow.interval) + 1
        departures = (flow.startTime + k * flow.interval for k in range(count))
        trips += [Trip(time, tuple(flow.route)) for time in departures if time < horizon]
    if not trips:
        raise UserError(FIELD, path, f"no vehicle in it departs before {horizon:g} s")
    return Demand.of(trips)


def other_vehicles(path: Path, vehicle: VehicleType) -> list[str]:
    """What the vehicles of a CityFlow flow file are said to be and ``vehicle`` is not, in words."""
    ours = {
        "length": vehicle.length,
        "minGap": vehicle.min_gap,
        "maxSpeed": vehicle.max_speed,
        "headwayTime": vehicle.tau,
    }
    flows = _flows(path)
    found = []
    for name, value in ours.items():
        theirs = [flow.vehicle.get(name, value) for flow in flows]
        others = [one for one in theirs if one != value]
        if others:
            found.append(
                f"{name} {others[0]} in {len(others)} of {len(flows)} entries, not {value:g}"
            )
    return found


def _flows(path: Path) -> list[_Flow]:
    flows: list[_Flow] = parse(_ADAPTER, read_json(path, FIELD), FIELD, path)
    return flows
