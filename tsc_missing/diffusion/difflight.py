"""DiffLight: the noise model and the inverse dynamics, their loss, and planning with them."""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from tsc_missing.diffusion.batch import Inputs, TrainingBatch, blank, group_table
from tsc_missing.diffusion.config import DiffLightConfig, Precision
from tsc_missing.diffusion.dcm import Communication
from tsc_missing.diffusion.ddim import sample
from tsc_missing.diffusion.history import History, Plan, inputs_at_inference
from tsc_missing.diffusion.inverse_dynamics import InverseDynamics, phase_means
from tsc_missing.diffusion.noise_model import NoiseModel
from tsc_missing.diffusion.pace import Pace, paced
from tsc_missing.diffusion.prcd import combine
from tsc_missing.diffusion.scaling import Scaling
from tsc_missing.diffusion.schedule import CosineSchedule
from tsc_missing.diffusion.stformer import STFormer
from tsc_missing.diffusion.unet import UNet
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.sensing.observation import N_FEATURES


@dataclass(frozen=True)
class Losses:
    """The terms of Eq. loss; ``total`` is what to minimise."""

    total: Tensor
    diffusion: Tensor
    inverse: Tensor
    inverse_accuracy: Tensor  # part of the known transitions whose phase gets the highest logit


class DiffLightModel(nn.Module):
    """One set of weights for any number of intersections, neighbours and phases."""

    def __init__(self, config: DiffLightConfig) -> None:
        """Fresh weights from torch's global generator."""
        super().__init__()
        self.config = config
        self.schedule = CosineSchedule(config.diffusion_steps)
        self.scaling = Scaling(config.scaling)
        network = UNet if config.noise_model == "unet" else STFormer
        self.noise_model: NoiseModel = network(config)
        self.inverse = InverseDynamics(config.inverse_width) if config.inverse_dynamics else None

    def use(self, precision: Precision) -> "DiffLightModel":
        """Compute the noise model's products in this precision; weights stay in float32."""
        self.noise_model.precision = precision
        return self

    @property
    def channels(self) -> int:
        """F', what is diffused of a cell: the features and, without inverse dynamics, green."""
        return N_FEATURES + (not self.config.inverse_dynamics)

    # Training

    def loss(self, batch: TrainingBatch, generator: torch.Generator) -> Losses:
        """Eq. loss on the targets of the batch; k, ε and β come from the generator."""
        inputs = batch.inputs
        truth = blank(batch.values, (inputs.known | batch.target) & inputs.slots.unsqueeze(1))
        x0 = self._with_green(truth, batch.green)
        known = self._known(inputs)
        count = len(x0)
        k = torch.randint(1, self.config.diffusion_steps + 1, (count,), generator=generator)
        noise = torch.randn(x0.shape, generator=generator)
        keep = torch.rand(count, generator=generator) >= self.config.reward_dropout
        x = torch.where(known, x0, self.schedule.q_sample(x0, k, noise))
        predicted = self._predicted(x, k, inputs, keep)
        wanted = noise if self.config.predict == "noise" else x0
        weight = self._targets(batch).float()
        error = (predicted - wanted).square() * weight
        diffusion = error.sum() / weight.sum().clamp(min=1)
        inverse, accuracy = self._inverse_loss(batch, truth)
        return Losses(diffusion + inverse, diffusion, inverse.detach(), accuracy)

    def _predicted(self, x: Tensor, k: Tensor, inputs: Inputs, keep: Tensor) -> Tensor:
        """What the loss is of: a whole window with rewards, or with a partial loss ε̂ of Eq. PRCD.

        There what is not known of the past is denoised without them, as it is when planning.
        """
        if not self.config.partial_loss:
            whole: Tensor = self.noise_model(x, k, inputs, keep)
            return whole
        future = torch.arange(self.config.steps) >= self.config.history
        rewarded = inputs.known | (inputs.observable & future[:, None])
        with_reward, without = self.noise_model.branches(x, k, inputs)
        return combine(with_reward, without, rewarded & keep[:, None, None], guidance=1.0)

    def _inverse_loss(self, batch: TrainingBatch, truth: Tensor) -> tuple[Tensor, Tensor]:
        """Cross-entropy of the phase from now to the next step, over the known transitions."""
        if self.inverse is None:
            return truth.new_zeros(()), truth.new_zeros(())
        last = self.config.history - 1
        logits = self.inverse(
            truth[:, last], truth[:, last + 1], batch.inputs.slots, batch.phases, batch.phase_mask
        )
        usable = batch.action_known.float()
        action = torch.where(batch.action_known, batch.action, batch.phase_mask.int().argmax(dim=1))
        each = nn.functional.cross_entropy(logits, action, reduction="none")
        hit = (logits.argmax(dim=1) == action).float()
        total = usable.sum().clamp(min=1)
        return (each * usable).sum() / total, (hit * usable).sum() / total

    def _targets(self, batch: TrainingBatch) -> Tensor:
        """(B, T, L, F'): the cells that the loss counts."""
        there = batch.inputs.slots.unsqueeze(1)
        target = (batch.target & there).unsqueeze(-1).expand(-1, -1, -1, N_FEATURES)
        if self.config.inverse_dynamics:
            return target
        future = torch.arange(self.config.steps) >= self.config.history
        return torch.cat((target, (there & future[:, None]).unsqueeze(-1)), dim=-1)

    # Planning

    def initial_noise(self, intersections: int, generator: torch.Generator) -> Tensor:
        """x^K ~ N(0, I), (N, T, L, F')."""
        shape = (intersections, self.config.steps, N_SLOTS, self.channels)
        return torch.randn(shape, generator=generator)

    @torch.inference_mode()
    def plan(
        self,
        history: History,
        noise: Tensor,
        sampling_steps: int,
        guided: bool = True,
        pace: Pace | None = None,
    ) -> Plan:
        """Fill the history, plan the future and score the phases of all N intersections.

        ``noise`` (N, T, L, F') is x^K; not ``guided`` leaves the reward out, for imputation only.
        By a ``pace`` most intersections take fewer reverse steps.
        """
        config = self.config
        table = group_table(history.neighbours, history.slots)
        inputs, values = inputs_at_inference(history, table, config, self.scaling)
        talking = config.dcm and config.neighbours
        rows = None if pace is None else pace.rows
        talk = Communication(inputs, values, table, history.downstream, talking, rows)
        x0 = self._with_green(values, _padded(history.green, config.horizon))
        known = self._known(inputs)

        def estimate(x: Tensor, k: Tensor, due: Inputs) -> Tensor:
            return self._x0(x, k, due, guided)

        def after_step(x: Tensor, estimate: Tensor) -> Tensor:
            talk.exchange(estimate[..., :N_FEATURES])
            return torch.where(known, x0, x)

        leading = config.predict == "noise"
        ks = self.schedule.sampling_steps(sampling_steps, leading=leading)
        denoise = paced(estimate, talk.inputs, ks, pace)
        x = sample(self.schedule, denoise, torch.where(known, x0, noise), ks, after_step)
        made = blank(x[..., :N_FEATURES], inputs.slots.unsqueeze(1))
        vehicles = self.scaling.vehicles(made)
        past = vehicles[:, : config.history]
        return Plan(
            imputed=torch.where(history.known.unsqueeze(-1), history.values.float(), past),
            future=vehicles[:, config.history :],
            logits=self._logits(x, history),
        )

    def _x0(self, x: Tensor, k: Tensor, inputs: Inputs, guided: bool) -> Tensor:
        """x̂^0 (N, T, L, F') within the range of the data, by PRCD."""
        if guided:
            observable = inputs.observable
            if self.config.padded_rewards:
                observable = torch.ones_like(observable)
            with_reward, without = self.noise_model.branches(x, k, inputs)
            predicted = combine(with_reward, without, observable, self.config.guidance)
        else:
            predicted = self.noise_model(x, k, inputs, torch.zeros(len(x), dtype=torch.bool))
        if self.config.predict == "noise":
            predicted = self.schedule.x0_from_noise(x, k, predicted)
        clip = self.config.scaling.clip
        low = torch.tensor([0.0, 0.0, -1.0][: self.channels])
        high = torch.tensor([clip, clip, 1.0][: self.channels])
        return predicted.clamp(low, high)

    def _logits(self, x: Tensor, history: History) -> Tensor:
        """(N, P) from the present and the next step of a trajectory (N, T, L, F')."""
        last = self.config.history - 1
        if self.inverse is None:
            score = x[:, last + 1, :, -1]
            return phase_means(score, history.slots, history.phases, history.phase_mask)
        now, then = x[:, last, :, :N_FEATURES], x[:, last + 1, :, :N_FEATURES]
        logits: Tensor = self.inverse(now, then, history.slots, history.phases, history.phase_mask)
        return logits

    # Both

    def _with_green(self, values: Tensor, green: Tensor) -> Tensor:
        """(B, T, L, F'): green as a channel of -1 and 1 where actions are diffused too."""
        if self.config.inverse_dynamics:
            return values
        return torch.cat((values, 2 * green.unsqueeze(-1).float() - 1), dim=-1)

    def _known(self, inputs: Inputs) -> Tensor:
        """(B, T, L, F'): what is written in; past signals are always known."""
        known = inputs.known.unsqueeze(-1).expand(-1, -1, -1, N_FEATURES)
        if self.config.inverse_dynamics:
            return known
        past = torch.arange(self.config.steps) < self.config.history
        return torch.cat((known, past[:, None, None].expand_as(known[..., :1])), dim=-1)


def _padded(past: Tensor, steps: int) -> Tensor:
    """(N, C, L) with ``steps`` steps of False behind it."""
    return nn.functional.pad(past, (0, 0, 0, steps))
