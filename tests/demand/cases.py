"""A small grid and profiles on it, for the tests of drawing and fitting."""

from tsc_missing.demand.profile import DemandProfile, draw_demand, plain_turns
from tsc_missing.demand.trips import Demand
from tsc_missing.network.grid import GridSpec, build_grid

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


def draw(
    drawn_from: DemandProfile, seed: int = 0, volume: float = 1.0, horizon: float = HORIZON
) -> Demand:
    return draw_demand(drawn_from, TURNS, seed, volume, horizon)
