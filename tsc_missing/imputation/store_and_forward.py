"""Store-and-forward imputation: a lane is like the lanes around it were a step ago."""

from collections.abc import Sequence

import numpy as np

from tsc_missing.controllers.base import ControlContext
from tsc_missing.imputation.base import Imputer
from tsc_missing.imputation.memory import LastReported
from tsc_missing.network.model import BoolArray, FloatArray, IntArray, Network
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.sensing.observation import N_FEATURES, Observation


class StoreAndForward(Imputer):
    """A missing slot takes the mean of the previous step of its k nearest slots.

    The store-and-forward method (SFM) of the DiffLight paper's baselines, with k = 12: nearest
    along traffic movements. Two things that its text leaves open are settled by what controls
    better (``docs/experiments.md``): the slot itself is the nearest, and of the k only those
    count that reported in the previous step; if none did, all do, with the values that they were
    filled with then. Before the first step all slots count as empty. Means are per lane, times
    the lanes of the slot.
    """

    def __init__(self, k: int = 12) -> None:
        """``k`` is the number of nearest slots, the slot itself among them."""
        self.k = k

    def reset(self, context: ControlContext) -> None:
        """Forget everything and get ready for a run on the context's network."""
        shape = (context.network.n, N_SLOTS)
        table = nearest_slots(context.network, self.k)
        self._nearest = np.maximum(table, 0)
        self._exists = table >= 0
        lanes = context.network.lane_parts.reshape(-1, 1)
        self._lanes = np.where(lanes > 0, lanes, 1.0)  # (12 N, 1); 1 where there is no slot
        self._previous = np.zeros((*shape, N_FEATURES))
        self._reported: BoolArray = np.zeros(shape, dtype=bool)
        self._exits = LastReported(shape)

    def fill(self, observation: Observation) -> Observation:
        """The observation with finite values everywhere; what was reported stays as it was."""
        per_lane = self._previous.reshape(-1, N_FEATURES) / self._lanes
        mean = np.einsum("sk,skf->sf", self._weights(), per_lane[self._nearest])
        estimate = (mean * self._lanes).reshape(self._previous.shape)
        self._previous = np.where(observation.mask[:, :, None], observation.values, estimate)
        self._reported = observation.mask
        return observation.filled(
            self._previous, self._exits.update(observation.exits, observation.mask)
        )

    def _weights(self) -> FloatArray:
        """(12 N, k): equal parts of those that reported in the previous step, or else of all."""
        reported = self._exists & self._reported.reshape(-1)[self._nearest]
        used = np.where(reported.any(axis=1, keepdims=True), reported, self._exists)
        weights: FloatArray = used / used.sum(axis=1, keepdims=True)
        return weights


def nearest_slots(network: Network, k: int) -> IntArray:
    """(12 N, k): the flat slots nearest to each flat slot, itself first, then -1.

    A hop leads from a slot to one that feeds its road, or to one on the road it leads to. Of slots
    as many hops away those reached by a last hop upstream come first.
    """
    upstream, downstream = _hops(network)
    table = np.full((network.n * N_SLOTS, k), -1, dtype=np.int64)
    for slot in range(len(table)):
        nearest = _nearest(upstream, downstream, slot, k)
        table[slot, : len(nearest)] = nearest
    return table


def _nearest(
    upstream: Sequence[Sequence[int]], downstream: Sequence[Sequence[int]], slot: int, k: int
) -> list[int]:
    """The first k slots of a breadth-first search from ``slot``."""
    found = [slot]
    seen, front = {slot}, [slot]
    while front and len(found) < k:
        reached = [s for hops in (upstream, downstream) for at in front for s in hops[at]]
        front = [s for s in dict.fromkeys(reached) if s not in seen]
        seen.update(front)
        found += front
    return found[:k]


def _hops(network: Network) -> tuple[list[list[int]], list[list[int]]]:
    """For each flat slot those one hop upstream and those one hop downstream, in order.

    ``neighbours`` sees through junctions without signals and ``downstream`` has no limit of three:
    a hop is what either of them knows.
    """
    size = network.n * N_SLOTS
    edges = {
        (int(feeder), slot)
        for slot, feeders in enumerate(network.neighbours.reshape(size, -1))
        for feeder in feeders[feeders >= 0]
    } | {
        (slot, int(follower))
        for slot, followers in enumerate(network.downstream.reshape(size, -1))
        for follower in followers[followers >= 0]
    }
    upstream: list[list[int]] = [[] for _ in range(size)]
    downstream: list[list[int]] = [[] for _ in range(size)]
    for feeder, follower in sorted(edges):
        upstream[follower].append(feeder)
        downstream[feeder].append(follower)
    return upstream, downstream
