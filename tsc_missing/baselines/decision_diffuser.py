"""Decision Diffuser.

A diffusion model of the states to come, given those that are known and a return y, and inverse
dynamics f that tell the phase that leads from the present state to the planned next one:

    L = ‖x^0 − x̂^0(x^k, k, y or nothing)‖² − log f(a_t | s_t, s_{t+1}),

with y left out with probability p. A run asks for a quantile of the logs' returns, and denoises by
classifier-free guidance, x̂^0(φ) + ω (x̂^0(y) − x̂^0(φ)). Ajay et al., "Is conditional generative
modeling all you need for decision-making?", ICLR 2023; their squared error of f is a
cross-entropy here, because phases are discrete.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from tsc_missing.baselines.base import accuracy, descend, optimiser_of
from tsc_missing.baselines.config import DecisionDiffuserSettings
from tsc_missing.baselines.plans import STATES, PlanLearner, Planner, states
from tsc_missing.baselines.transitions import Logs, Steps
from tsc_missing.diffusion.ddim import Denoiser
from tsc_missing.diffusion.inverse_dynamics import InverseDynamics
from tsc_missing.diffusion.layers import mlp
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.qlearning.networks import NO_PHASE, THERE, Graph
from tsc_missing.sensing.observation import N_FEATURES


class DecisionDiffuserPolicy(Planner):
    """Plans states, and takes the phase that leads to the next of them."""

    def __init__(self, settings: DecisionDiffuserSettings) -> None:
        """Fresh weights from torch's global generator."""
        super().__init__(settings, STATES)
        self.guidance = settings.guidance
        self.wish: nn.Sequential = mlp(1, settings.width, settings.width)
        self.inverse = InverseDynamics(2 * settings.width)

    def trajectories(self, steps: Steps) -> Tensor:
        """(R, K, 24): the states."""
        return states(steps)

    def condition(self, features: Tensor, returns: Tensor, told: Tensor) -> Tensor:
        """(R, D): the present, and a return (R,) where it is ``told`` (R,)."""
        wish = self.wish(self.returns(returns).unsqueeze(-1))
        e: Tensor = self.present(features) + torch.where(told.unsqueeze(-1), wish, 0.0)
        return e

    def denoiser(self, features: Tensor, there: Tensor) -> Denoiser:
        """Classifier-free guidance to the return that is asked for; both in one pass."""
        asked = self.returns.asked.expand(2 * len(features))
        told = torch.arange(2 * len(features)) < len(features)
        condition = self.condition(features.repeat(2, 1, 1), asked, told)
        there = there.repeat(2, 1, 1)

        def denoise(x: Tensor, k: Tensor) -> Tensor:
            found, plain = self.model(x.repeat(2, 1, 1), k, there, condition).chunk(2)
            guided: Tensor = plain + self.guidance * (found - plain)
            return guided

        return denoise

    def scores(self, recent: Steps, generator: torch.Generator) -> Tensor:
        """(B, N, P): logits of the inverse dynamics."""
        plan = self.plan(recent, generator)
        return self.phases_between(
            plan[:, :, self.history - 1],
            plan[:, :, self.history],
            recent.features[:, -1],
            recent.graph,
        )

    def phases_between(self, now: Tensor, then: Tensor, features: Tensor, graph: Graph) -> Tensor:
        """(B, N, P): logits of the phases from states ``now`` to ``then`` (R, 24).

        ``features`` (B, N, 12, N_NAMES). There are no negative counts, also where they are
        planned.
        """
        batch, n, _, _ = features.shape
        ends = (x.clamp(min=0).view(-1, N_SLOTS, N_FEATURES) for x in (now, then))
        tables = (part.repeat(batch, 1, 1) for part in (graph.phases, graph.phase_mask[:, None]))
        phases, mask = tables
        slots = features[..., THERE].flatten(0, 1) > 0
        logits: Tensor = self.inverse(*ends, slots, phases, mask.squeeze(1))
        return logits.view(batch, n, -1).masked_fill(~graph.phase_mask, NO_PHASE)


class DecisionDiffuser(PlanLearner):
    """The error of the denoised states, and the cross-entropy of the inverse dynamics."""

    online: DecisionDiffuserPolicy
    policy: DecisionDiffuserPolicy

    def __init__(self, settings: DecisionDiffuserSettings) -> None:
        """Fresh weights from torch's global generator."""
        super().__init__(settings, DecisionDiffuserPolicy(settings))
        self._dropout = settings.return_dropout
        self._quantile = settings.asked_quantile
        self.optimisers = {"plans": optimiser_of([self.online], settings.learning_rate)}

    def prepare(self, logs: Logs) -> None:
        """Measure the returns."""
        self.measure(logs, self._quantile)

    def update(self, batch: Steps, step: int, generator: torch.Generator) -> dict[str, float]:
        """One step down the gradient of L, and the average after it."""
        error, logits = self._both(self.online, batch, generator)
        phase = batch.phase[:, self.now]
        inverse = functional.cross_entropy(logits.flatten(0, 1), phase.flatten())
        loss = error + inverse
        descend(self.optimisers["plans"], loss, self.settings.gradient_norm)
        self.average(step)
        return {
            "loss": loss.item(),
            "diffusion": error.item(),
            "inverse": inverse.item(),
            "inverse_accuracy": accuracy(logits, phase),
        }

    def held_out(self, batch: Steps, generator: torch.Generator) -> dict[str, float]:
        """Of what decides; ``inverse_accuracy`` is with the next state that came in the log."""
        error, logits = self._both(self.policy, batch, generator)
        phase = batch.phase[:, self.now]
        scores = self.policy.scores(self.past(batch), generator)
        return {
            "accuracy": accuracy(scores, phase),
            "inverse_accuracy": accuracy(logits, phase),
            "diffusion": error.item(),
        }

    def _both(
        self, planner: DecisionDiffuserPolicy, batch: Steps, generator: torch.Generator
    ) -> tuple[Tensor, Tensor]:
        """The error of the denoised states, and logits (B, N, P) of the phases now."""
        x0, x, k, there = self.noised(planner, batch, generator)
        told = torch.rand(len(x), generator=generator) >= self._dropout
        condition = planner.condition(self.features_now(batch), self.return_now(batch), told)
        found = planner.model(x, k, there, condition)
        ends = x0[:, :, self.now], x0[:, :, self.now + 1]
        logits = planner.phases_between(*ends, batch.features[:, self.now], batch.graph)
        return self.error(planner, batch, x0, found), logits
