"""A cross and a T-junction, observations of them, and controllers that follow a script."""

import numpy as np

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.network.model import Network
from tsc_missing.network.records import (
    IntersectionRecord,
    LaneRecord,
    LinkRecord,
    NetworkRecord,
    PhaseRecord,
)
from tsc_missing.network.slots import APPROACHES, TURNS
from tsc_missing.sensing.observation import Observation

A, B = 0, 1  # the cross, the T-junction to its east

# per intersection: slot, entrance lanes, exit road
CROSS = [
    ("N-left", ["nA_2"], "AB"),
    ("N-straight", ["nA_1"], "As"),
    ("N-right", ["nA_0"], "Aw"),
    ("E-left", ["BA_2"], "As"),
    ("E-straight", ["BA_1"], "Aw"),
    ("E-right", ["BA_0"], "An"),
    ("S-left", ["sA_2"], "Aw"),
    ("S-straight", ["sA_1"], "An"),
    ("S-right", ["sA_0"], "AB"),
    ("W-left", ["wA_2"], "An"),
    ("W-straight", ["wA_1"], "AB"),
    ("W-right", ["wA_0"], "As"),
]
TEE = [
    ("E-left", ["eB_0"], "Bs"),
    ("E-straight", ["eB_0"], "BA"),
    ("S-left", ["sB_1"], "BA"),
    ("S-right", ["sB_0"], "Be"),
    ("W-straight", ["AB_1", "AB_2"], "Be"),
    ("W-right", ["AB_0"], "Bs"),
]
CROSS_PHASES = [
    ["E-straight", "W-straight"],
    ["N-straight", "S-straight"],
    ["E-left", "W-left"],
    ["N-left", "S-left"],
]
TEE_PHASES = [["E-straight", "W-straight"], ["E-left", "E-straight"], ["S-left"]]
LANES = {"eB": 1, "sB": 2}  # all other roads have three


def slot(name: str) -> int:
    approach, turn = name.split("-")
    return 3 * APPROACHES.index(approach) + TURNS.index(turn)


def _record(name, x, roads, movements, phases) -> IntersectionRecord:
    links = [
        LinkRecord(from_lane=lane, to_lane=f"{exit_road}_0", slot=slot(movement))
        for movement, lanes, exit_road in movements
        for lane in lanes
    ]
    served = [[slot(movement) for movement in phase] for phase in phases]
    nobody = tuple(() for _ in links)
    return IntersectionRecord(
        id=name,
        x=x,
        y=0.0,
        roads=roads,
        links=tuple(links),
        foes=nobody,
        yields=nobody,
        phases=tuple(
            PhaseRecord(
                name=str(p), links=tuple(k for k, link in enumerate(links) if link.slot in slots)
            )
            for p, slots in enumerate(served)
        ),
        free=tuple(k for k, link in enumerate(links) if link.slot % 3 == 2),
    )


def cross_and_tee() -> Network:
    """Lanes of 300 m at 10 m/s; the cross has four phases, the T three; right turns are free."""
    cross = _record("A", 0.0, {"nA": 0, "BA": 1, "sA": 2, "wA": 3}, CROSS, CROSS_PHASES)
    tee = _record("B", 300.0, {"eB": 1, "sB": 2, "AB": 3}, TEE, TEE_PHASES)
    roads = ["nA", "BA", "sA", "wA", "eB", "sB", "AB", "An", "As", "Aw", "Be", "Bs"]
    into_b = tuple(("A", slot(name)) for name in ("N-left", "S-right", "W-straight"))
    into_a = tuple(("B", slot(name)) for name in ("E-straight", "S-left"))
    return Network(
        name="cross and tee",
        record=NetworkRecord(
            intersections=(cross, tee),
            lanes={
                f"{road}_{k}": LaneRecord(road=road, length=300.0, speed=10.0)
                for road in roads
                for k in range(LANES.get(road, 3))
            },
            upstream={road: {"AB": into_b, "BA": into_a}.get(road, ()) for road in roads},
        ),
    )


def slots_of(network: Network, values: dict[tuple[int, str], float]) -> np.ndarray:
    """(N, 12): zeros but for the named slots."""
    array = np.zeros(network.slot_mask.shape)
    for (n, name), value in values.items():
        assert network.slot_mask[n, slot(name)], name
        array[n, slot(name)] = value
    return array


def observe(
    network: Network,
    vehicles: dict | None = None,
    queue: dict | None = None,
    exits: dict | None = None,
    phase: list[int] | None = None,
    step: int = 0,
) -> Observation:
    """What is named, zeros elsewhere, everything reported."""
    counts, queues = slots_of(network, vehicles or {}), slots_of(network, queue or {})
    return Observation(
        step=step,
        time=15.0 * step,
        values=np.stack([counts, queues], axis=2),
        exits=slots_of(network, exits or {}),
        mask=np.ones(network.slot_mask.shape, dtype=bool),
        reward=-queues.sum(axis=1),
        phase=np.array(phase or [-1] * network.n),
        red_steps=np.zeros(network.slot_mask.shape, dtype=np.int64),
    )


def context(network: Network, flows=None, sensors=None, interval=15.0, least=1) -> ControlContext:
    shape = network.slot_mask.shape
    return ControlContext(
        network=network,
        turning_flows=np.zeros(shape) if flows is None else slots_of(network, flows),
        sensors=np.ones(shape, dtype=bool) if sensors is None else sensors,
        decision_interval=interval,
        lost_time=5.0,
        min_steps=np.full(network.n, least),
        seed=1,
    )


def with_holes(observation: Observation, holes: np.ndarray) -> Observation:
    """The observation with nothing reported at ``holes`` (N, 12)."""
    return Observation(
        **{
            **vars(observation),
            "values": np.where(holes[:, :, None], np.nan, observation.values),
            "exits": np.where(holes, np.nan, observation.exits),
            "mask": observation.mask & ~holes,
            "reward": np.where(holes.any(axis=1), np.nan, observation.reward),
        }
    )


class Scripted(Controller):
    """Answers whatever it is told to; raises it if it is an exception."""

    def __init__(self, answer=None) -> None:
        self.answer = answer
        self.resets = 0
        self.asked = 0
        self.estimate = None

    def reset(self, context: ControlContext) -> None:
        self.resets += 1

    def decide(self, observation: Observation):
        self.asked += 1
        if isinstance(self.answer, BaseException):
            raise self.answer
        return self.answer(observation) if callable(self.answer) else self.answer

    def estimates(self):
        if isinstance(self.estimate, BaseException):
            raise self.estimate
        return self.estimate
