"""Imputation by the diffusion model: what it generates where nothing was reported."""

from pathlib import Path

import numpy as np

from tsc_missing.config import BELIEF_STEPS
from tsc_missing.controllers.base import ControlContext
from tsc_missing.controllers.difflight import load_planner
from tsc_missing.controllers.recent import reported
from tsc_missing.imputation.base import Imputer
from tsc_missing.imputation.memory import LastReported
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.sensing.observation import Observation


class DiffusionImputer(Imputer):
    """A missing slot takes what the model generates for the present from the last C steps.

    The model is not asked for rewards: these are the values it believes, not those it wishes for.
    Vehicles on exit lanes that lead to no signal are not in the model; they keep their last
    report.
    """

    def __init__(
        self, weights: Path, sampling_steps: int = BELIEF_STEPS, blind_steps: int | None = None
    ) -> None:
        """Load the weights; ``sampling_steps`` reverse steps a decision.

        At intersections without a sensor ``blind_steps``, if there are more of them.

        Raises ``UserError`` for weights that cannot be used.
        """
        self._planner = load_planner(weights, sampling_steps, guided=False, blind_steps=blind_steps)

    def reset(self, context: ControlContext) -> None:
        """Forget everything and get ready for a run on the context's network."""
        self._exits = LastReported((context.network.n, N_SLOTS))
        self._planner.reset(context)

    def fill(self, observation: Observation) -> Observation:
        """The observation with finite values everywhere; what was reported stays as it was.

        Values are NaN where the model, being broken, generates NaN.
        """
        exits = self._exits.update(observation.exits, observation.mask)
        generated = self._planner.plan(observation).present
        known = reported(observation)[:, :, None]
        return observation.filled(np.where(known, observation.values, generated), exits)
