"""An imputer of a user's own, kept apart from what others see."""

import copy

import numpy as np

from tsc_missing.controllers.base import ControlContext
from tsc_missing.imputation.base import Imputer
from tsc_missing.own_code import make_own, named, set_apart
from tsc_missing.sensing.observation import Observation

FIELD = "imputer"
SINGLE = 1e-6  # what single precision may change


class OwnImputer(Imputer):
    """The imputer of a name ``FILE.py:CLASS``; it gets copies, as ``OwnController`` does."""

    def __init__(self, name: str) -> None:
        """Raises ``UserError`` where there is no such class, or it cannot be made."""
        self._name = name
        self._inner = make_own(name, FIELD, Imputer)

    def reset(self, context: ControlContext) -> None:
        """Reset it with a context of its own."""
        with named(self._name, FIELD, "reset"), set_apart():
            self._inner.reset(copy.deepcopy(context))

    def fill(self, observation: Observation) -> Observation:
        """The observation with its numbers; raises where what was reported is not there as it was.

        And where that is no observation, or has other shapes, or a number that is not finite. Of
        its answer only ``values`` and ``exits`` are taken.
        """
        with set_apart():
            filled = self._inner.fill(observation.copy())
        if not isinstance(filled, Observation):
            raise TypeError(f"fill must return an Observation, not {type(filled).__name__}")
        found = {}
        for name in ("values", "exits"):
            before, after = getattr(observation, name), np.asarray(getattr(filled, name))
            if after.shape != before.shape:
                raise ValueError(f"{name} must have the shape {before.shape}, not {after.shape}")
            if not np.isfinite(after).all():
                raise ValueError(f"{name} must be finite everywhere")
            seen = np.isfinite(before)
            if not np.allclose(after[seen], before[seen], rtol=SINGLE, atol=SINGLE):
                raise ValueError(f"fill must leave the reported {name} as they are")
            found[name] = np.where(seen, before, after)
        return observation.filled(found["values"], found["exits"])
