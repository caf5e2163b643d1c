"""DiffLight: a diffusion model fills the holes, and it or a plan on a traffic model decides."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from tsc_missing.config import GUIDED_STEPS
from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.rolling_horizon import HorizonPlans
from tsc_missing.controllers.scores import TIE_DECIMALS, phase_scores
from tsc_missing.errors import UserError
from tsc_missing.network.model import BoolArray, FloatArray, IntArray
from tsc_missing.sensing.observation import QUEUE, Observation

if TYPE_CHECKING:  # torch takes seconds and 200 MB: only runs that use it import it
    from tsc_missing.controllers.planner import Planned, Planner
    from tsc_missing.qlearning.controller import PhaseValues

Scoring = Literal["inverse", "queue", "mixed", "value", "horizon"]
"""How phases are scored on a plan.

``inverse``: by the inverse dynamics from the present to the planned next step (the paper).
``queue``: by the queues of the present, imputed where not observed (max-queue).
``mixed``: as ``inverse`` where the intersection has a sensor, so that the reward guides its plan;
as ``queue`` where it has none.
``value``: by a Q-network on the present, imputed where not observed; where an intersection is not
seen at all, by the mean over several samples of it.
``horizon``: by the waiting of the best plan of the next minute that begins with a phase, made on a
traffic model (``rolling_horizon.HorizonPlans``) whose belief of what is not observed the present
corrects.
"""

NO_PHASE = -1  # the answer where the model gave no number


class DiffLight(Controller):
    """The diffusion controller; needs no imputer, and no sensor at every intersection.

    Where what it generates or the scores are not finite it answers -1, which is no phase: ``Safe``
    answers.
    """

    needs_values = False

    def __init__(
        self,
        weights: Path,
        sampling_steps: int = GUIDED_STEPS,
        scoring: Scoring = "inverse",
        q_weights: Sequence[Path] = (),
        samples: int = 1,
        blind_steps: int | None = None,
    ) -> None:
        """Load the weights; ``sampling_steps`` reverse steps a decision.

        At intersections without a sensor ``blind_steps``, if there are more of them.

        ``q_weights`` are those of Q-networks for the scoring "value": the first decides, and where
        nothing is known the mean over all of them and over ``samples`` of what may be. Raises
        ``UserError`` for weights that cannot be used.
        """
        copies = samples if scoring == "value" else 1
        self._planner = load_planner(
            weights, sampling_steps, is_guided(scoring), copies, blind_steps
        )
        self._scoring = scoring
        self._q = [load_q(path, self._planner) for path in q_weights]
        self._planned: Planned | None = None
        self._plans: HorizonPlans | None = None
        self._believed: FloatArray | None = None

    @property
    def is_published(self) -> bool:
        """Whether its model is that of the paper, without what was added here."""
        return self._planner.model.config.is_published

    def reset(self, context: ControlContext) -> None:
        """Forget everything and get ready for a run on the context's network."""
        self._planned = None
        self._network = context.network
        self._by_inverse = self._where_inverse(context)
        self._planner.reset(context)
        self._values = [make(context) for make in self._q]
        self._believed = None
        self._plans = HorizonPlans(context) if self._scoring == "horizon" else None

    def decide(self, observation: Observation) -> IntArray:
        """(N,): the phase with the highest score; ties go to the lowest phase."""
        self._planned = self._believed = None
        try:
            self._planned = self._planner.plan(observation)
        except Exception:
            if self._plans is not None:
                self._plans.costs(observation)  # the traffic goes on meanwhile
            raise
        if self._plans is None:
            return best_finite(self._scores(self._planned))
        guess = np.maximum(self._planned.present, 0.0)
        phases = best_finite(-self._plans.costs(observation, guess))
        self._believed = self._plans.believed(observation)
        broken = ~np.isfinite(guess).all(axis=(1, 2))
        return np.where(broken, NO_PHASE, phases)

    def estimates(self) -> FloatArray | None:
        """(N, 12, F) [vehicles]: the present that the last decision was based on, without holes."""
        if self._plans is not None:
            return self._believed
        return None if self._planned is None else self._planned.present

    def plans(self) -> FloatArray | None:
        """(N, H, 12, F) [vehicles]: what the model generated of the next H steps."""
        return None if self._planned is None else self._planned.future

    def _where_inverse(self, context: ControlContext) -> BoolArray:
        """(N,): whether the inverse dynamics scores the intersection's phases."""
        if self._scoring == "mixed":
            return np.asarray((context.sensors & context.network.slot_mask).any(axis=1))
        return np.full(context.network.n, self._scoring == "inverse")

    def _scores(self, planned: Planned) -> FloatArray:
        """(N, P), -inf without the phase."""
        if self._values:
            return self._mean_values(planned)
        queues = phase_scores(self._network, planned.present[:, :, QUEUE])
        return np.where(self._by_inverse[:, None], planned.logits, queues)

    def _mean_values(self, planned: Planned) -> FloatArray:
        """(N, P): of the first Q-network, of all of them where nothing is known."""
        unseen = nothing_known(planned.known, self._network.slot_mask)
        samples = np.moveaxis(planned.samples, 2, 0)  # (C, M, N, 12, F)
        red_steps = planned.red_steps.swapaxes(0, 1)[:, None]
        seen = (planned.known | unseen[:, None, None]).swapaxes(0, 1)[:, None]
        first, *others = self._values if unseen.any() else self._values[:1]
        scores = first.of(samples, red_steps, seen).mean(axis=0)
        if others:
            more = [values.of(samples, red_steps, seen).mean(axis=0) for values in others]
            scores[unseen] = np.mean([scores, *more], axis=0)[unseen]
        return np.asarray(scores)


def is_guided(scoring: Scoring) -> bool:
    """Whether plans are guided by rewards; else the present is wanted as it is believed."""
    return scoring in ("inverse", "mixed")


def nothing_known(known: BoolArray, slots: BoolArray) -> BoolArray:
    """(N,): where nothing of an intersection's ``slots`` (N, 12) is ``known`` (N, C, 12).

    There a sample is one of the worlds that may be, and all of it counts as seen: that there are
    several samples is what tells how uncertain it is.
    """
    return np.asarray(~(known & slots[:, None]).any(axis=(1, 2)))


def best_finite(scores: FloatArray) -> IntArray:
    """(N,): the phase with the largest of ``scores`` (N, P), ``NO_PHASE`` where one is NaN."""
    best = np.argmax(scores.round(TIE_DECIMALS), axis=1)
    usable = ~np.isnan(scores).any(axis=1) & np.isfinite(scores.max(axis=1))
    return np.where(usable, best, NO_PHASE).astype(np.int64)


def load_planner(
    weights: Path,
    sampling_steps: int,
    guided: bool,
    samples: int = 1,
    blind_steps: int | None = None,
) -> Planner:
    """The model of a weights file, ready to plan; imports torch.

    Raises ``UserError`` for weights that cannot be used.
    """
    from tsc_missing.controllers.planner import Planner

    return Planner(weights, sampling_steps, guided, samples, blind_steps)


def load_q(weights: Path, planner: Planner) -> Callable[[ControlContext], PhaseValues]:
    """What makes the values of a run from its context; imports torch.

    Raises ``UserError`` for weights that look further back than the planner fills holes.
    """
    from tsc_missing.qlearning.controller import PhaseValues
    from tsc_missing.qlearning.weights import load_q_network

    network, _ = load_q_network(weights)
    filled = planner.model.config.history
    if 1 + network.history > filled:
        words = f"they look back {network.history} steps, and the diffusion weights {filled - 1}"
        raise UserError("q_weights", weights, words)
    return lambda context: PhaseValues.for_run(network, context)
