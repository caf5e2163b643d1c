"""Room kept on roads that other intersections lead to."""

import numpy as np

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.scores import overruled
from tsc_missing.controllers.wrapper import Wrapper
from tsc_missing.network.model import FloatArray, IntArray, Network
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.sensing.observation import Observation

UNSEEN_ARRIVALS = 1 / 60  # [vehicles/s a lane] at the least, where no sensor ever reports


class Room:
    """Which roads between the intersections of a network are filling, and what empties them.

    Who looks for the longest queues forgets the short roads, which never hold many vehicles; once
    one is full nothing enters it, and the roads behind fill in turn: so grids of short blocks come
    to a stand. Here a slot is filling when a lane of it has room for fewer than ``space`` vehicles,
    and somebody is on it. Roads on which vehicles enter the network do not count: no intersection
    is behind them.
    """

    def __init__(self, network: Network, space: float, spacing: float) -> None:
        """``space`` [vehicles a lane], above 0; ``spacing`` [m] that a standing vehicle takes."""
        self._network = network
        self._space = space
        served = network.phases.any(axis=1) & ~network.free_slots
        self._fed = served & (network.neighbours >= 0).any(axis=2)
        self.storage = storage(network, spacing)
        self._anybody = lane_share(network)  # [vehicles] of a slot if one is on one of its lanes
        self._lanes = np.maximum(network.slot_lane_count, 1) * self._anybody

    def kept(self, phases: IntArray, vehicles: FloatArray) -> IntArray:
        """(N,): ``phases`` (N,), but where slots are filling the phase that empties them.

        That whose filling slots are fullest (the sum of ``vehicles`` (N, 12) over storage); among
        equal ones the given one, if it is one of them.
        """
        room = (self.storage - vehicles) / self._lanes
        filling = self._fed & (vehicles >= self._anybody) & (room < self._space)
        fullness = vehicles / np.maximum(self.storage, 1.0)
        return overruled(self._network, phases, np.where(filling, fullness, 0.0))


class Spillback(Wrapper):
    """A controller that empties a road before its queue reaches back into the intersection behind.

    ``Room`` has the rule. Where a sensor did not report, the controller's own estimate stands in,
    if it has one. Where none ever reports, a road is taken to have as many vehicles at the least as
    a light flow brings during its red: an estimate that is wrong for long lets a road fill, and
    nothing there would tell.
    """

    def __init__(self, controller: Controller, space: float) -> None:
        """``space`` [vehicles a lane], above 0."""
        super().__init__(controller)
        self._space = space

    def reset(self, context: ControlContext) -> None:
        """Reset the controller and take the network's roads."""
        network = context.network
        self._room = Room(network, self._space, context.spacing)
        lanes = network.lane_parts
        arrivals = UNSEEN_ARRIVALS * context.decision_interval * lanes
        self._arrivals = np.where(context.sensors, 0.0, arrivals)  # (N, 12) in a decision step
        super().reset(context)

    def decide(self, observation: Observation) -> IntArray:
        """(N,): the controller's phases but where a slot is filling."""
        phases = self.controller.decide(observation)
        believed = np.nan_to_num(self.believed_vehicles(observation), posinf=0.0, neginf=0.0)
        arrived = np.minimum(self._arrivals * observation.red_steps, self._room.storage)
        return self._room.kept(phases, np.maximum(believed, arrived))


def storage(network: Network, spacing: float) -> FloatArray:
    """(N, 12): standing vehicles that fit on a slot's lanes, as far as its sensors reach.

    ``spacing`` [m] is what a standing vehicle takes, its gap included.
    """
    lanes, slots, weights = network.sensor_slots
    metres = np.array([network.record.lanes[name].length for name in network.sensor_lanes])
    total = np.bincount(slots, weights * metres[lanes], minlength=network.n * N_SLOTS)
    return np.asarray(total.reshape(network.n, N_SLOTS) / spacing)


def lane_share(network: Network) -> FloatArray:
    """(N, 12): the part that a slot has of its lanes, which others may share; 1 without lanes.

    Counts and ``storage`` of a lane are divided among its slots.
    """
    lanes = network.slot_lane_count
    return np.asarray(np.where(lanes > 0, network.lane_parts / np.maximum(lanes, 1), 1.0))
