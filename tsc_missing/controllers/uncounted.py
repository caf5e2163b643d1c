"""Turning flows at slots without sensors, where nobody counted them."""

from typing import Self

import numpy as np

from tsc_missing.controllers.base import ControlContext
from tsc_missing.controllers.upstream import Roads
from tsc_missing.network.model import BoolArray, FloatArray
from tsc_missing.network.slots import N_SLOTS, TURNS

ROUNDS = 5  # of fitting; more change nothing that matters
PULL = 0.5  # by which guessed flows from outside go to what is usual elsewhere in a step
TINY = 1e-3  # [vehicles/s] that keeps quotients of empty roads near 1
LEAST = 1e-6  # [vehicles/s] of a slot, so that there are parts of every road


class UncountedTurns:
    """What the roads around tell of the flows of slots that have no sensor.

    Such a slot has at first, for each of its lanes, what lanes of the same turn have elsewhere in
    the mean (what was told, where none of the turn has a sensor), or what was guessed of it. Two
    things are known better: how many enter its road, from what is let go upstream; and how many
    came out to the roads with sensors downstream, from what entered there (who begins there
    included). So the flows are fitted to exits and roads in turns (iterative proportional fitting,
    Deming and Stephan, Annals of Mathematical Statistics 11, 1940; of turning flows Furness's
    method).
    """

    def __init__(self, context: ControlContext, roads: Roads) -> None:
        """For a run on the context's network."""
        network = context.network
        self._roads = roads
        self.slots = network.slot_mask & ~context.sensors  # (N, 12) without a sensor
        self._seen = network.slot_mask & context.sensors
        self._lanes = network.lane_parts
        self._uncounted = self._by_turn(context.turning_flows / 3600.0)
        whole = self._of_roads(self.slots) == 0
        exits = whole & (self._of_roads(roads.fed) > 0) & (roads.parts @ self.slots.ravel() > 0)
        self._exits = np.flatnonzero(exits)  # (E,) roads
        self._into = roads.parts[exits]  # (E, N * 12)
        self._told = self._into.sum(axis=0)  # (N * 12,) the part of a slot's flow that is told of

    @classmethod
    def of(cls, context: ControlContext, roads: Roads) -> Self | None:
        """None with turning counts, and where all slots have a sensor or none has."""
        sensors = context.sensors[context.network.slot_mask]
        return (
            None if context.counted or sensors.all() or not sensors.any() else cls(context, roads)
        )

    def fitted(self, inflow: FloatArray, guessed: bool) -> FloatArray:
        """(N, 12) [vehicles/s]: the usual ``inflow`` (N, 12), of slots without a sensor as fitted.

        ``guessed``: that of these slots was drawn by guesses.
        """
        elsewhere = self._elsewhere(inflow)
        prior = inflow + LEAST if guessed else elsewhere
        alone = inflow + PULL * (elsewhere - inflow) if guessed else elsewhere
        total = self._of_roads(np.where(self._roads.fed, inflow, alone) * self.slots)
        flows = self._split(prior, total)
        others = self._into @ np.where(self._seen, inflow, 0.0).ravel()
        out = np.maximum(self._of_roads(inflow)[self._exits] - others, 0.0)
        for _ in range(ROUNDS):
            scale = (out + TINY) / (self._into @ flows.ravel() + TINY)
            slot_scale = scale @ self._into + 1.0 - self._told
            flows = self._split(flows * slot_scale.reshape(flows.shape), total)
        return np.where(self.slots, flows, inflow)

    def _elsewhere(self, inflow: FloatArray) -> FloatArray:
        """(N, 12) [vehicles/s]: for the slots' lanes what those of a turn have where it is seen."""
        flow, lanes = self._by_turn(inflow * self._seen), self._by_turn(self._lanes * self._seen)
        told = self._uncounted / np.maximum(self._by_turn(self._lanes), LEAST)
        rate = np.divide(flow, lanes, out=told, where=lanes > 0)
        return np.asarray(self._lanes * (np.tile(rate, N_SLOTS // len(TURNS)) + LEAST))

    def _by_turn(self, values: FloatArray) -> FloatArray:
        """(3,): the sum of ``values`` (N, 12) over all slots of a turn."""
        return np.asarray(values.reshape(-1, len(TURNS)).sum(axis=0))

    def _split(self, flows: FloatArray, total: FloatArray) -> FloatArray:
        """(N, 12): the ``total`` (R + 1,) of roads on slots without a sensor, in parts of flows."""
        return self._roads.shares(flows * self.slots) * total[self._roads.road]

    def _of_roads(self, values: FloatArray | BoolArray) -> FloatArray:
        """(R + 1,): the sum of ``values`` (N, 12) on each road."""
        found = np.zeros(len(self._roads.parts))
        np.add.at(found, self._roads.road, values)
        return found
