"""Room kept on roads that other intersections lead to."""

import numpy as np

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.recent import reported
from tsc_missing.controllers.scores import overruled
from tsc_missing.network.model import FloatArray, IntArray, Network
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.sensing.observation import VEHICLES, Observation


class Spillback(Controller):
    """A controller that empties a road before its queue reaches back into the intersection behind.

    Who looks for the longest queues forgets the short roads, which never hold many vehicles; once
    one is full nothing enters it, and the roads behind fill in turn: so grids of short blocks come
    to a stand. Here a slot is filling when a lane of it has room for fewer than ``space`` vehicles,
    and somebody is on it. Where slots are filling, the phase whose filling slots are fullest (the
    sum of vehicles over storage) is next, whatever the controller says; among equal ones the
    controller's own. Roads on which vehicles enter the network do not count: no intersection
    is behind them.

    Where a sensor did not report, the controller's own estimate stands in, if it has one.
    """

    def __init__(self, controller: Controller, space: float) -> None:
        """``space`` [vehicles a lane], above 0."""
        self.controller = controller
        self._space = space

    def reset(self, context: ControlContext) -> None:
        """Reset the controller and take the network's roads."""
        network = self._network = context.network
        served = network.phases.any(axis=1) & ~network.free_slots
        self._fed = served & (network.neighbours >= 0).any(axis=2)
        self._storage = storage(network, context.spacing)
        self._lanes = np.maximum(network.slot_lane_count, 1)
        self.controller.reset(context)

    def decide(self, observation: Observation) -> IntArray:
        """(N,): the controller's phases but where a slot is filling."""
        phases = self.controller.decide(observation)
        vehicles = self._vehicles(observation)
        room = (self._storage - vehicles) / self._lanes
        filling = self._fed & (vehicles >= 1) & (room < self._space)
        fullness = vehicles / np.maximum(self._storage, 1.0)
        return overruled(self._network, phases, np.where(filling, fullness, 0.0))

    def _vehicles(self, observation: Observation) -> FloatArray:
        """(N, 12): seen, else estimated, else 0."""
        seen = observation.values[:, :, VEHICLES]
        estimates = self.controller.estimates()
        if estimates is not None:
            seen = np.where(reported(observation), seen, estimates[:, :, VEHICLES])
        return np.nan_to_num(seen, nan=0.0, posinf=0.0, neginf=0.0)

    def estimates(self) -> FloatArray | None:
        """(N, 12, F): the controller's."""
        return self.controller.estimates()

    def plans(self) -> FloatArray | None:
        """(N, H, 12, F): the controller's."""
        return self.controller.plans()


def storage(network: Network, spacing: float) -> FloatArray:
    """(N, 12): standing vehicles that fit on a slot's lanes, as far as its sensors reach.

    ``spacing`` [m] is what a standing vehicle takes, its gap included.
    """
    lanes, slots, weights = network.sensor_slots
    metres = np.array([network.record.lanes[name].length for name in network.sensor_lanes])
    total = np.bincount(slots, weights * metres[lanes], minlength=network.n * N_SLOTS)
    return np.asarray(total.reshape(network.n, N_SLOTS) / spacing)
