"""Diffuser.

A diffusion model of states and phases together, x, and a model J of the return that follows from
a trajectory and its noise level:

    L = ‖x^0 − x̂^0(x^k, k)‖² + (R − J(x^k, k))².

A plan is denoised with guidance, x̂^0 + s (1 − ᾱ^k) ∇J(x^k, k), and its first phase is run. Janner
et al., "Planning with diffusion for flexible behavior synthesis", ICML 2022. A phase is in x as
the twelve slots that it serves, 1 or 0, and the phase of a plan is the one nearest to it of those
that the intersection has.
"""

import torch
from torch import Tensor, nn

from tsc_missing.baselines.base import accuracy, descend, optimiser_of
from tsc_missing.baselines.config import DiffuserSettings
from tsc_missing.baselines.plans import STATES, PlanLearner, Planner, Present, flat, states
from tsc_missing.baselines.transitions import Logs, Steps, served_slots
from tsc_missing.diffusion.ddim import Denoiser
from tsc_missing.diffusion.layers import StepEmbedding
from tsc_missing.diffusion.unet import Block
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.qlearning.networks import NO_PHASE, THERE

CHANNELS = STATES + N_SLOTS


class ReturnModel(nn.Module):
    """J: the scaled return from the present step on."""

    def __init__(self, width: int) -> None:
        """The first half of a U-Net."""
        super().__init__()
        self.present = Present(width)
        self.diffusion_step = StepEmbedding(width)
        self.enter = Block(CHANNELS + 1, width, width)
        self.down = Block(width, 2 * width, width)
        self.out = nn.Linear(2 * width, 1)

    def forward(self, x: Tensor, k: Tensor, there: Tensor, present: Tensor) -> Tensor:
        """(R,) of x^k (R, channels, T), ``k`` (R,) or (1,), ``there`` (R, 1, T), (R, D)."""
        e = present + self.diffusion_step(k)
        top = self.enter(torch.cat((x, there), dim=1), e)
        low = self.down(nn.functional.avg_pool1d(top, 2), e)
        found: Tensor = self.out(low.mean(dim=-1)).squeeze(-1)
        return found


class DiffuserPolicy(Planner):
    """Plans states and phases, and runs the first phase."""

    def __init__(self, settings: DiffuserSettings) -> None:
        """Fresh weights from torch's global generator."""
        super().__init__(settings, CHANNELS)
        self.guidance = settings.guidance
        self.value = ReturnModel(settings.width)

    def trajectories(self, steps: Steps) -> Tensor:
        """(R, K, 36): the states, and the slots that the phases serve."""
        return torch.cat((states(steps), flat(served_slots(steps.graph, steps.phase))), dim=-1)

    def denoiser(self, features: Tensor, there: Tensor) -> Denoiser:
        """Guided up the gradient of the return."""
        present, of_value = self.present(features), self.value.present(features)

        def denoise(x: Tensor, k: Tensor) -> Tensor:
            x0: Tensor = self.model(x, k, there, present)
            if self.guidance == 0:
                return x0
            scale = self.guidance * (1 - self.schedule.alpha_bar[k].float())
            return x0 + scale * self.ascent(x, k, there, of_value)

        return denoise

    def ascent(self, x: Tensor, k: Tensor, there: Tensor, present: Tensor) -> Tensor:
        """(R, channels, T): ∇J, also where no gradients are kept."""
        with torch.inference_mode(False), torch.enable_grad():
            x = x.detach().clone().requires_grad_()
            value = self.value(x, k.clone(), there.clone(), present.clone())
            (gradient,) = torch.autograd.grad(value.sum(), x)
        return gradient

    def scores(self, recent: Steps, generator: torch.Generator) -> Tensor:
        """(B, N, P): minus the squared distance of a phase's slots from the planned ones."""
        graph = recent.graph
        planned = self.plan(recent, generator)[:, STATES:, self.history - 1]
        planned = planned.view(*recent.phase[:, -1].shape, 1, N_SLOTS)
        slots = recent.features[:, -1, :, :, THERE].unsqueeze(2)
        distance = ((planned - graph.phases.float()) ** 2 * slots).sum(dim=-1)
        return (-distance).masked_fill(~graph.phase_mask, NO_PHASE)


class Diffuser(PlanLearner):
    """The errors of the denoised trajectories and of the returns."""

    online: DiffuserPolicy
    policy: DiffuserPolicy

    def __init__(self, settings: DiffuserSettings) -> None:
        """Fresh weights from torch's global generator."""
        super().__init__(settings, DiffuserPolicy(settings))
        self.optimisers = {"plans": optimiser_of([self.online], settings.learning_rate)}

    def prepare(self, logs: Logs) -> None:
        """Measure the returns."""
        self.measure(logs, 1.0)

    def update(self, batch: Steps, step: int, generator: torch.Generator) -> dict[str, float]:
        """One step down the gradient of L, and the average after it."""
        error, value_error = self._both(self.online, batch, generator)
        loss = error + value_error
        descend(self.optimisers["plans"], loss, self.settings.gradient_norm)
        self.average(step)
        return {
            "loss": loss.item(),
            "diffusion": error.item(),
            "return_error": value_error.item(),
        }

    def held_out(self, batch: Steps, generator: torch.Generator) -> dict[str, float]:
        """Of what decides; ``return_error`` is J's squared error, in variances of the return."""
        error, value_error = self._both(self.policy, batch, generator)
        scores = self.policy.scores(self.past(batch), generator)
        return {
            "accuracy": accuracy(scores, batch.phase[:, self.now]),
            "diffusion": error.item(),
            "return_error": value_error.item(),
        }

    def _both(
        self, planner: DiffuserPolicy, batch: Steps, generator: torch.Generator
    ) -> tuple[Tensor, Tensor]:
        """The two terms of L."""
        x0, x, k, there = self.noised(planner, batch, generator)
        features = self.features_now(batch)
        found = planner.model(x, k, there, planner.present(features))
        value = planner.value(x, k, there, planner.value.present(features))
        value_error = (value - planner.returns(self.return_now(batch))).square().mean()
        return self.error(planner, batch, x0, found), value_error
