"""Controlling with a Q-network."""

from collections import deque
from pathlib import Path
from typing import Self

import numpy as np
import torch

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.scores import best_phases
from tsc_missing.errors import UserError
from tsc_missing.network.model import BoolArray, FloatArray, IntArray, Network
from tsc_missing.qlearning.features import (
    SlotTables,
    certainty_features,
    past_features,
    slot_features,
)
from tsc_missing.qlearning.networks import Graph, QNetwork
from tsc_missing.qlearning.weights import load_q_network
from tsc_missing.sensing.observation import Observation


class PhaseValues:
    """The values that a Q-network gives the phases of a network."""

    def __init__(
        self,
        q: QNetwork,
        network: Network,
        interval: float,
        detector_length: float | None = None,
    ) -> None:
        """Get ready for a network of intersections; ``interval`` [s] between decisions.

        Sensors cover ``detector_length`` [m] before the stop line, None for whole lanes.
        """
        self._q = q
        self._graph = Graph.of(network)
        self._tables = SlotTables.of(network, interval, detector_length)

    @classmethod
    def for_run(cls, q: QNetwork, context: ControlContext) -> Self:
        """Of a run's network, decisions and sensors."""
        interval, length = context.decision_interval, context.detector_length
        return cls(q, context.network, interval, length)

    @torch.inference_mode()
    def of(
        self, values: FloatArray, red_steps: IntArray, known: BoolArray | None = None
    ) -> FloatArray:
        """(…, N, P) of the last of C ≥ 1 decision steps that follow each other.

        ``values`` (C, …, N, 12, F) [vehicles], ``red_steps`` (C, …, N, 12); ``known`` (C, …, N, 12)
        is false where values were filled in, None where nothing was. The last two may have axes of
        length 1 where ``values`` have several states of the same signals. NaN in gives NaN for
        what depends on it.
        """
        red_steps = np.broadcast_to(red_steps, values.shape[:-1])
        now = slot_features(self._tables, values[-1], red_steps[-1])
        seen = -1 - self._q.history
        parts = [now, past_features(values[seen:], red_steps[seen:], self._q.history)[-1]]
        if self._q.certainty:
            everything = np.ones(red_steps.shape, dtype=bool)
            told = certainty_features(everything if known is None else known)
            parts.append(np.broadcast_to(told, (*now.shape[:-1], told.shape[-1])))
        features = torch.from_numpy(np.concatenate(parts, axis=-1))
        found = self._q(features.reshape(-1, *features.shape[-3:]), self._graph)
        return np.asarray(found.double().numpy()).reshape(*now.shape[:-2], -1)


class QPolicy(Controller):
    """The phase of the highest value; needs complete observations."""

    def __init__(self, network: QNetwork, name: str) -> None:
        """``name`` is what errors call it."""
        self._q = network
        self._name = name

    def reset(self, context: ControlContext) -> None:
        """Take the network, and forget what was before."""
        self._values = PhaseValues.for_run(self._q, context)
        self._seen: deque[Observation] = deque(maxlen=1 + self._q.history)

    def decide(self, observation: Observation) -> IntArray:
        """(N,): the best phases; raises ``ValueError`` on a hole."""
        self._seen.append(observation)
        values = np.stack([seen.values for seen in self._seen])
        red_steps = np.stack([seen.red_steps for seen in self._seen])
        return best_phases(self._values.of(values, red_steps), self._name)


def make_q_policy(name: str, weights: Path) -> QPolicy:
    """The Q-network ``name`` with these weights; ``UserError`` if they are another's."""
    network, manifest = load_q_network(weights)
    found = manifest["algorithm"]
    if found != name:
        raise UserError("q_weights", weights, f"they are of {found}, not of {name}")
    return QPolicy(network, name)
