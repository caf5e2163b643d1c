"""A controller of a user's own, kept apart from what others decide by."""

import copy

import numpy as np

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.fallback import legal_phases
from tsc_missing.network.model import FloatArray, IntArray
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.own_code import make_own, named, set_apart
from tsc_missing.sensing.observation import N_FEATURES, Observation

FIELD = "controller"


class OwnController(Controller):
    """The controller of a name ``FILE.py:CLASS``.

    It gets copies, so that nothing that it writes into them reaches anybody else. An answer that
    is no phase is -1 there, and one of another shape or type raises; an error in ``reset`` is a
    ``UserError``.
    """

    def __init__(self, name: str) -> None:
        """Raises ``UserError`` where there is no such class, or it cannot be made."""
        self._name = name
        self._inner = make_own(name, FIELD, Controller)

    def reset(self, context: ControlContext) -> None:
        """Reset it with a context of its own."""
        self._network = context.network
        with named(self._name, FIELD, "reset"), set_apart():
            self._inner.reset(copy.deepcopy(context))

    def decide(self, observation: Observation) -> IntArray:
        """(N,): its phases, -1 where its answer is none."""
        with set_apart():
            answer = self._inner.decide(observation.copy())
        if not isinstance(answer, np.ndarray):
            raise TypeError(f"decide must answer a NumPy array, not {type(answer).__name__}")
        return legal_phases(answer, self._network)

    def estimates(self) -> FloatArray | None:
        """(N, 12, F): what it believes, if it says so; raises where that has another shape."""
        with set_apart():
            found = self._inner.estimates()
        shape = (self._network.n, N_SLOTS, N_FEATURES)
        if found is not None and np.shape(found) != shape:
            raise ValueError(f"estimates must have the shape {shape}, not {np.shape(found)}")
        return None if found is None else np.array(found, dtype=np.float64)
