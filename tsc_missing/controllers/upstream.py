"""Which slots feed which roads, and in what parts."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from tsc_missing.controllers.base import ControlContext
from tsc_missing.network.model import BoolArray, FloatArray, IntArray
from tsc_missing.network.slots import N_SLOTS


@dataclass(frozen=True)
class Roads:
    """The R roads into signals, each with the slots that vehicles on it may use.

    Slots whose lanes are on the same roads have a road together. A slot upstream that leads to
    several of them, through junctions without signals, sends to each the part that its turning
    counts have among theirs.
    """

    road: IntArray  # (N, 12) each slot's road, 0 to R - 1; R for slots that are not there
    parts: FloatArray  # (R + 1, N * 12) what of those who leave a slot enters each road
    fed: BoolArray  # (N, 12) whether signals upstream tell who enters

    @classmethod
    def of(cls, context: ControlContext) -> Self:
        """Of a network whose sensors cover whole roads; else who enters is told by no signal.

        Where detectors cover the last metres only, what leaves upstream is not there for long.
        """
        network = context.network
        record, shape = network.record, network.slot_mask.shape
        index = {name: n for n, name in enumerate(network.ids)}
        roads: dict[tuple[str, ...], int] = {}
        road = np.full(shape, -1, dtype=np.int64)
        for n, slots in enumerate(network.slot_lanes):
            for slot, lanes in enumerate(slots):
                names = tuple(sorted({record.lanes[lane].road for lane in lanes}))
                if names:
                    road[n, slot] = roads.setdefault(names, len(roads))
        road[road < 0] = len(roads)
        counted = np.bincount(road.ravel(), context.turning_flows.ravel(), len(roads) + 1)
        parts = np.zeros((len(roads) + 1, network.n * N_SLOTS))
        for names, r in roads.items():
            for name, slot in {pair for one in names for pair in record.upstream.get(one, ())}:
                parts[r, index[name] * N_SLOTS + slot] = counted[r] + 1.0
        parts /= np.maximum(parts.sum(axis=0), 1.0)
        fed = np.asarray(parts.any(axis=1))[road]
        if context.detector_length is not None:
            fed = np.zeros_like(fed)
        return cls(road, parts, fed)

    def entering(self, out: FloatArray) -> FloatArray:
        """(T, N, 12) [vehicles] who enter each slot's road of those ``out`` (T, N, 12) leave."""
        flat = out.reshape(len(out), -1) @ self.parts.T
        return np.asarray(flat[:, self.road])

    def shares(self, inflow: FloatArray) -> FloatArray:
        """(N, 12): the part that each slot has of the ``inflow`` (N, 12) of its road."""
        total = np.bincount(self.road.ravel(), inflow.ravel(), len(self.parts))[self.road]
        return np.divide(inflow, total, out=np.zeros_like(inflow), where=total > 0)
