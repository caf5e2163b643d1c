"""The training of the diffusion model."""

import math
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from safetensors.torch import save_file
from torch import Tensor

from tsc_missing.diffusion.difflight import DiffLightModel, Losses
from tsc_missing.diffusion.ema import Ema
from tsc_missing.diffusion.weights import load_weights, save_weights
from tsc_missing.diffusion.windows import Windows, training_batch
from tsc_missing.errors import UserError
from tsc_missing.offline.joined import Episodes
from tsc_missing.offline.windows import WindowSampler
from tsc_missing.seeding import stream
from tsc_missing.training.config import RESUMABLE, TrainingSettings
from tsc_missing.training.diverged import DivergedError
from tsc_missing.training.metrics import MetricsLog
from tsc_missing.training.steps import StepTraining, learning_rate
from tsc_missing.versions import git_revision, versions
from tsc_missing.weights.find import FILE, find_weights
from tsc_missing.weights.state import optimiser_state, part_of, restore_optimiser, under


@dataclass(frozen=True)
class Seen:
    """The state of a training for who watches it."""

    step: int
    steps: int
    loss: float
    inverse_accuracy: float
    windows_per_second: float


class Training(StepTraining[TrainingSettings, Seen]):
    """A training in a folder: metrics, a checkpoint, in the end the weights."""

    def __init__(
        self, settings: TrainingSettings, dataset: Episodes, folder: Path, resume: bool = False
    ) -> None:
        """Check everything that can be wrong, and load the checkpoint to resume from."""
        super().__init__(settings, dataset, folder)
        self.model = DiffLightModel(settings.model).use(settings.precision)
        if settings.begin and not resume:
            self._begun_from = _begin_with(self.model, settings.begin)
        self.ema = Ema(self.model, settings.ema_decay)
        self._optimiser = torch.optim.AdamW(
            self.model.parameters(), settings.learning_rate, weight_decay=settings.weight_decay
        )
        self._sampler = WindowSampler(
            dataset,
            settings.model.history,
            settings.model.horizon,
            settings.masks,
            settings.seed,
            settings.told_all,
            settings.resident,
            settings.renew,
        )
        self._means: _Means | None = None  # since the first step of this process
        self._begin(resume, RESUMABLE)
        dataset.check_episodes()

    def _advance(self) -> Seen:
        self._means = self._means or _Means(self.settings)
        losses, norm, rate = self.train_step()
        self._means.add(losses, norm, rate, time.perf_counter())
        return self._means.seen(self.step, losses)

    def _open_log(self) -> MetricsLog:
        return MetricsLog(self.folder, self.step - 1)

    def _row(self) -> dict[str, float]:
        assert self._means is not None
        return self._means.row()

    def train_step(self) -> tuple[Losses, float, float]:
        """One optimiser step; the losses, the gradient's norm and the learning rate."""
        windows = self._sampler.sample(self.step, self.settings.batch)
        noise = stream(self.settings.seed, f"noise-{self.step}").integers(2**63)
        generator = torch.Generator().manual_seed(int(noise))
        self.model.train()
        self._optimiser.zero_grad(set_to_none=True)
        losses = self.model.loss(training_batch(windows, self.settings.model), generator)
        losses.total.backward()  # type: ignore[no-untyped-call]
        norm = torch.nn.utils.clip_grad_norm_(self.model.parameters(), self.settings.gradient_norm)
        if not (math.isfinite(losses.total.item()) and math.isfinite(norm.item())):
            self._diverged(windows, losses)
        rate = learning_rate(self.settings, self.step)
        for group in self._optimiser.param_groups:
            group["lr"] = rate
        self._optimiser.step()
        self.ema.update(self.model)
        self.step += 1
        return losses, norm.item(), rate

    def _diverged(self, windows: Windows, losses: Losses) -> None:
        path = self.folder / f"diverged-step-{self.step}.safetensors"
        tensors = {name: tensor.contiguous() for name, tensor in asdict(windows).items()}
        self.folder.mkdir(parents=True, exist_ok=True)
        save_file(tensors, path, {"step": str(self.step), "seed": str(self.settings.seed)})
        self._save(self._wall)
        raise DivergedError(
            f"at step {self.step} the loss is {losses.total.item()} or its gradient is not finite; "
            f"the batch is in {path}, the checkpoint holds the weights before it"
        )

    def _tensors(self) -> dict[str, Tensor]:
        return {
            **under("model", self.model.state_dict()),
            **under("ema", self.ema.state_dict()),
            **under("optimiser", optimiser_state(self.model, self._optimiser)),
        }

    def _restore(self, tensors: dict[str, Tensor]) -> None:
        self.model.load_state_dict(part_of("model", tensors))
        self.ema.load_state_dict(part_of("ema", tensors))
        restore_optimiser(self.model, self._optimiser, part_of("optimiser", tensors))

    def _write_weights(self) -> Path:
        path = self.folder / FILE
        about = {
            "data": self._dataset.about(),
            "training": self.settings.model_dump(mode="json", exclude={"model", "data", "begin"}),
            "begun_from": self._begun_from,
            "seed": self.settings.seed,
            "steps": self.step,
            "wall_seconds": round(self._wall, 1),
            "versions": versions(),
            "git": git_revision(),
        }
        save_weights(self.ema.model, path, about)
        return path


def _begin_with(model: DiffLightModel, weights: str) -> str:
    """Put weights into a model; returns their checksum. ``UserError`` for those of another one."""
    path = find_weights(weights, field="begin")
    found, manifest = load_weights(path)
    if found.config != model.config:
        raise UserError("begin", weights, "they are of a model with another config")
    model.load_state_dict(found.state_dict())
    return str(manifest["checksum"])


class _Means:
    """Means since the last row of the log, and a smooth rate for who watches."""

    def __init__(self, settings: TrainingSettings) -> None:
        self._settings = settings
        self._rate = 0.0
        self._learning_rate = 0.0
        self._last = time.perf_counter()
        self._start()

    def _start(self) -> None:
        self._count = 0
        self._began = self._last
        self._sums = dict.fromkeys(
            ("loss", "diffusion", "inverse", "inverse_accuracy", "gradient_norm"), 0.0
        )

    def add(self, losses: Losses, norm: float, learning_rate: float, now: float) -> None:
        terms = (losses.total, losses.diffusion, losses.inverse, losses.inverse_accuracy)
        values = (*(term.item() for term in terms), norm)
        for name, value in zip(self._sums, values, strict=True):
            self._sums[name] += value
        rate = self._settings.batch / max(now - self._last, 1e-9)
        self._rate = rate if self._rate == 0 else 0.95 * self._rate + 0.05 * rate
        self._count += 1
        self._learning_rate = learning_rate
        self._last = now

    def seen(self, step: int, losses: Losses) -> Seen:
        accuracy = losses.inverse_accuracy.item()
        return Seen(step, self._settings.steps, losses.total.item(), accuracy, self._rate)

    def row(self) -> dict[str, float]:
        means = {name: total / self._count for name, total in self._sums.items()}
        speed = self._count * self._settings.batch / max(self._last - self._began, 1e-9)
        self._start()
        return {**means, "learning_rate": self._learning_rate, "windows_per_s": speed}
