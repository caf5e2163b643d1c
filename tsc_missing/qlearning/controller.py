"""Controlling with a Q-network."""

from pathlib import Path

import numpy as np
import torch

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.scores import best_phases
from tsc_missing.errors import UserError
from tsc_missing.network.model import FloatArray, IntArray
from tsc_missing.qlearning.features import SlotTables, slot_features
from tsc_missing.qlearning.networks import Graph, QNetwork
from tsc_missing.qlearning.weights import load_q_network
from tsc_missing.sensing.observation import Observation


class PhaseValues:
    """The values that a Q-network gives the phases of a network."""

    def __init__(self, network: QNetwork, context: ControlContext) -> None:
        """Get ready for a run on the context's network."""
        self._q = network
        self._graph = Graph.of(context.network)
        self._tables = SlotTables.of(context.network, context.decision_interval)

    @torch.inference_mode()
    def of(self, values: FloatArray, red_steps: IntArray) -> FloatArray:
        """(N, P) from values (N, 12, F) [vehicles]; NaN in gives NaN for what depends on it."""
        features = slot_features(self._tables, values, red_steps)
        found = self._q(torch.from_numpy(features).unsqueeze(0), self._graph)
        return np.asarray(found.squeeze(0).double().numpy())


class QPolicy(Controller):
    """The phase of the highest value; needs complete observations."""

    def __init__(self, network: QNetwork, name: str) -> None:
        """``name`` is what errors call it."""
        self._q = network
        self._name = name

    def reset(self, context: ControlContext) -> None:
        """Take the network."""
        self._values = PhaseValues(self._q, context)

    def decide(self, observation: Observation) -> IntArray:
        """(N,): the best phases; raises ``ValueError`` on a hole."""
        return best_phases(self._values.of(observation.values, observation.red_steps), self._name)


def make_q_policy(name: str, weights: Path) -> QPolicy:
    """The Q-network ``name`` with these weights; ``UserError`` if they are another's."""
    network, manifest = load_q_network(weights)
    found = manifest["algorithm"]
    if found != name:
        raise UserError("q_weights", weights, f"they are of {found}, not of {name}")
    return QPolicy(network, name)
