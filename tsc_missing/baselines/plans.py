"""What Diffuser and Decision Diffuser have in common: trajectories, their denoiser, sampling.

A trajectory is C + H successive steps of one intersection, channels over time; the first 24 are
the state: vehicles and queues of the twelve slots, scaled. What is known of it when a decision is
taken, states up to then and phases before, is written in after every reverse step. The denoiser is
a U-Net over time that predicts x^0. It knows all features of the present step besides, the same
that the other baselines decide by.
"""

import copy
from abc import abstractmethod

import torch
from torch import Tensor, nn

from tsc_missing.baselines.base import Learner, Policy, follow
from tsc_missing.baselines.config import PlannerSettings
from tsc_missing.baselines.returns import ReturnScale
from tsc_missing.baselines.transitions import Logs, Steps
from tsc_missing.diffusion.config import ScalingSettings
from tsc_missing.diffusion.ddim import Denoiser, sample
from tsc_missing.diffusion.layers import StepEmbedding
from tsc_missing.diffusion.scaling import Scaling
from tsc_missing.diffusion.schedule import CosineSchedule
from tsc_missing.diffusion.unet import Hourglass
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.qlearning.features import NAMES
from tsc_missing.qlearning.networks import THERE, SlotEmbedding
from tsc_missing.sensing.observation import N_FEATURES

STATES = N_SLOTS * N_FEATURES  # channels of a state, slot by slot
SCALING = Scaling(ScalingSettings())


class Present(nn.Module):
    """All features of the present step to an embedding."""

    def __init__(self, width: int) -> None:
        """Slots are told apart."""
        super().__init__()
        self.slot = SlotEmbedding(NAMES, width)
        self.merge = nn.Linear(N_SLOTS * width, width)

    def forward(self, features: Tensor) -> Tensor:
        """(R, 12, N_NAMES) to (R, D)."""
        e: Tensor = self.merge(self.slot(features).flatten(1))
        return e


class TrajectoryModel(Hourglass):
    """x̂^0 of x^k."""

    def __init__(self, channels: int, width: int) -> None:
        """``channels`` of a trajectory; one more tells the steps that there were."""
        super().__init__()
        self.diffusion_step = StepEmbedding(width)
        self.make_blocks(channels + 1, width)
        self.out = nn.Conv1d(width, channels, 1)

    def forward(self, x: Tensor, k: Tensor, there: Tensor, condition: Tensor) -> Tensor:
        """(R, channels, T) of the same; ``k`` (R,) or (1,), ``there`` (R, 1, T), (R, D)."""
        e = condition + self.diffusion_step(k)
        out: Tensor = self.out(self.through(torch.cat((x, there), dim=1), e))
        return out


class Planner(Policy):
    """Plans a trajectory from what is known."""

    known: Tensor

    def __init__(self, settings: PlannerSettings, channels: int) -> None:
        """``channels`` of a trajectory: the state's, then those that are not known at present."""
        super().__init__()
        self.history = settings.history
        self.settings = settings
        self.returns = ReturnScale()
        self.schedule = CosineSchedule(settings.diffusion_steps)
        self.present = Present(settings.width)
        self.model = TrajectoryModel(channels, settings.width)
        steps = torch.arange(settings.history + settings.horizon)
        now = settings.history - 1
        last = torch.full((channels, 1), now - 1)
        last[:STATES] = now
        self.register_buffer("known", steps <= last, persistent=False)  # (channels, T)

    @abstractmethod
    def trajectories(self, steps: Steps) -> Tensor:
        """(R, K, channels) of K steps, R = B * N."""

    @abstractmethod
    def denoiser(self, features: Tensor, there: Tensor) -> Denoiser:
        """What plans denoise with; features of the present (R, 12, N_NAMES), (R, 1, T)."""

    def plan(self, recent: Steps, generator: torch.Generator) -> Tensor:
        """(R, channels, T): the last C of some steps, and H more.

        All intersections begin with the same noise, so their order is all the same to them.
        """
        ahead = (0, self.settings.horizon)
        past = self.trajectories(recent)[:, -self.history :].transpose(1, 2)
        given, there = (
            nn.functional.pad(part, ahead) for part in (past, _there(recent, self.history))
        )
        batch, _, n = recent.phase.shape
        noise = torch.randn((batch, 1, *given.shape[1:]), generator=generator)
        noise = self.settings.temperature * noise.expand(-1, n, -1, -1).flatten(0, 1)

        def write_in(x: Tensor, x0: Tensor | None = None) -> Tensor:
            return torch.where(self.known, given, x)

        denoise = self.denoiser(recent.features[:, -1].flatten(0, 1), there)
        ks = self.schedule.sampling_steps(self.settings.sampling_steps)
        return sample(self.schedule, denoise, write_in(noise), ks, write_in)


class PlanLearner(Learner):
    """Learns to denoise; the moving average of what learns is what plans."""

    padded = True
    online: Planner
    policy: Planner

    def __init__(self, settings: PlannerSettings, online: Planner) -> None:
        """``online`` is what learns."""
        super().__init__()
        self.length = settings.history + settings.horizon
        self.ahead = settings.horizon
        self.discount = settings.discount
        self.now = settings.history - 1
        self.settings = settings
        self.online = online
        self.policy = copy.deepcopy(online).requires_grad_(False)

    def measure(self, logs: Logs, quantile: float) -> None:
        """Measure the returns of all steps."""
        for planner in (self.online, self.policy):
            planner.returns.measure(logs.returns(whole=False), quantile)

    def average(self, step: int) -> None:
        """Let the average follow; faster in the first steps."""
        follow(self.policy, self.online, max(self.settings.average_rate, 9 / (10 + step)))

    def noised(
        self, planner: Planner, batch: Steps, generator: torch.Generator
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """x^0 and x^k with what is known written in (R, channels, T), k (R,), there (R, 1, T)."""
        x0 = planner.trajectories(batch).transpose(1, 2)
        k = torch.randint(1, self.settings.diffusion_steps + 1, (len(x0),), generator=generator)
        noise = torch.randn(x0.shape, generator=generator)
        x = torch.where(planner.known, x0, planner.schedule.q_sample(x0, k, noise))
        ahead = (0, self.settings.horizon)
        there = nn.functional.pad(_there(self.past(batch), self.now + 1), ahead)
        return x0, x, k, there

    def error(self, planner: Planner, batch: Steps, x0: Tensor, found: Tensor) -> Tensor:
        """The mean squared error of x̂^0 over what is not known, of slots that are there."""
        slots = self.features_now(batch)[..., THERE]
        rest = slots.repeat(1, (x0.shape[1] - STATES) // N_SLOTS)
        counts = torch.cat((slots.repeat_interleave(N_FEATURES, dim=1), rest), dim=1)
        weight = counts.unsqueeze(-1) * ~planner.known
        return ((found - x0) ** 2 * weight).sum() / weight.sum()

    def features_now(self, batch: Steps) -> Tensor:
        """(R, 12, N_NAMES)."""
        return batch.features[:, self.now].flatten(0, 1)

    def return_now(self, batch: Steps) -> Tensor:
        """(R,): what is to go from the present on."""
        return batch.to_go[:, self.now].flatten()

    def past(self, batch: Steps) -> Steps:
        """What is known of a sample when the decision is taken."""
        return batch.first(self.now + 1)


def flat(x: Tensor) -> Tensor:
    """(B, K, N, …) to (B * N, K, …)."""
    return x.transpose(1, 2).flatten(0, 1)


def states(steps: Steps) -> Tensor:
    """(R, K, 24): vehicles and queue of each slot, scaled."""
    return flat(SCALING.values(steps.values)).flatten(2)


def _there(steps: Steps, count: int) -> Tensor:
    """(R, 1, count): 1 for those of the last steps that there were."""
    return (
        flat(steps.there[:, -count:, None].expand_as(steps.phase[:, -count:])).float().unsqueeze(1)
    )
