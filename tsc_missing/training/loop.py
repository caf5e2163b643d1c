"""The training loop: the same weights whether it ran through or was stopped and resumed.

All that is random at a step depends on the seed and the step's number: the windows, their masks
and the noise.
"""

import contextlib
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Protocol

import torch
from safetensors.torch import save_file

from tsc_missing.diffusion.difflight import DiffLightModel, Losses
from tsc_missing.diffusion.ema import Ema
from tsc_missing.diffusion.weights import save_weights
from tsc_missing.diffusion.windows import Windows, training_batch
from tsc_missing.errors import UserError
from tsc_missing.files import check_new_training
from tsc_missing.offline.dataset import Dataset
from tsc_missing.offline.windows import WindowSampler
from tsc_missing.seeding import stream
from tsc_missing.training import checkpoint
from tsc_missing.training.config import RESUMABLE, TrainingSettings
from tsc_missing.training.metrics import MetricsLog
from tsc_missing.versions import git_revision, versions

WEIGHTS = "weights.safetensors"


@dataclass(frozen=True)
class Seen:
    """The state of a training for who watches it."""

    step: int
    steps: int
    loss: float
    inverse_accuracy: float
    windows_per_second: float


Watch = Callable[[Seen], None]


class DivergedError(RuntimeError):
    """The loss or the gradient is not finite; the weights are those of the step before."""


class StoppedError(Exception):
    """The training was asked to stop; ``step`` is the checkpoint's."""

    def __init__(self, step: int) -> None:
        """Nothing is lost."""
        self.step = step
        super().__init__(f"stopped at step {step}")


class Training:
    """A training in a folder: metrics, a checkpoint, in the end the weights."""

    def __init__(
        self, settings: TrainingSettings, dataset: Dataset, folder: Path, resume: bool = False
    ) -> None:
        """Check everything that can be wrong, and load the checkpoint to resume from."""
        self.settings = settings
        self.folder = folder
        self.step = 0
        self._dataset = dataset
        self._wall = 0.0
        torch.manual_seed(int(stream(settings.seed, "weights").integers(2**31)))
        self.model = DiffLightModel(settings.model).use(settings.precision)
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
        if resume:
            self._resume()
        else:
            check_new_training(folder)

    @property
    def checkpoint(self) -> Path:
        """The file."""
        return self.folder / checkpoint.FILE

    def run(self, watch: Watch | None = None, stop: Callable[[], bool] = lambda: False) -> Path:
        """Train to the last step and write the weights; returns their file.

        ``stop`` is asked after every step: once it is true the state is saved, and ``StoppedError``
        raised. A full disk raises ``UserError``: the last checkpoint is whole.
        """
        began = time.perf_counter() - self._wall
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            log = MetricsLog(self.folder, self.step)
            with contextlib.closing(log):
                self._loop(log, began, watch, stop)
            self._save(time.perf_counter() - began)
            return self._write_weights()
        except OSError as error:
            raise UserError(
                "out",
                self.folder,
                f"cannot be written ({error.strerror}); the last checkpoint is whole, and "
                "--resume goes on from it",
            ) from error

    def _loop(
        self, log: MetricsLog, began: float, watch: Watch | None, stop: Callable[[], bool]
    ) -> None:
        means = _Means(self.settings)
        if self.step == 0:
            self._save(0.0)
        saved = time.perf_counter()
        while self.step < self.settings.steps:
            losses, norm, rate = self.train_step()
            now = time.perf_counter()
            means.add(losses, norm, now)
            if watch is not None:
                watch(means.seen(self.step, losses))
            if self.step % self.settings.log_steps == 0 or self.step == self.settings.steps:
                log.write(means.row(self.step, now - began, rate))
            stopping = stop()
            if stopping or now - saved >= self.settings.checkpoint_seconds:
                self._save(now - began)
                saved = time.perf_counter()
            if stopping:
                raise StoppedError(self.step)

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

    def _save(self, wall_seconds: float) -> None:
        self._wall = wall_seconds
        at = checkpoint.Progress(
            step=self.step,
            wall_seconds=wall_seconds,
            settings=self.settings.model_dump(mode="json"),
            data=self._dataset.checksum,
        )
        checkpoint.save_checkpoint(self.checkpoint, self.model, self.ema, self._optimiser, at)

    def _resume(self) -> None:
        at, tensors = checkpoint.load_checkpoint(self.checkpoint)
        checkpoint.check_same(self.folder, at, self.settings, RESUMABLE, self._dataset)
        checkpoint.restore(self.checkpoint, tensors, self.model, self.ema, self._optimiser)
        self.step, self._wall = at.step, at.wall_seconds

    def _write_weights(self) -> Path:
        path = self.folder / WEIGHTS
        about = {
            "data": self._dataset.about(),
            "training": self.settings.model_dump(mode="json", exclude={"model", "data"}),
            "seed": self.settings.seed,
            "steps": self.step,
            "wall_seconds": round(self._wall, 1),
            "versions": versions(),
            "git": git_revision(),
        }
        save_weights(self.ema.model, path, about)
        return path


class Rates(Protocol):
    """The settings that a learning rate follows from."""

    @property
    def steps(self) -> int: ...  # noqa: D102
    @property
    def warm_up(self) -> int: ...  # noqa: D102
    @property
    def learning_rate(self) -> float: ...  # noqa: D102
    @property
    def final_learning_rate(self) -> float: ...  # noqa: D102


def learning_rate(settings: Rates, step: int) -> float:
    """A rise over ``warm_up`` steps, then half a cosine from the highest to the final rate."""
    rise = min(1.0, (step + 1) / (settings.warm_up + 1))
    part = min(1.0, step / settings.steps)
    low, high = settings.final_learning_rate, settings.learning_rate
    return rise * (low + (high - low) * (1 + math.cos(math.pi * part)) / 2)


class _Means:
    """Means since the last row of the log, and a smooth rate for who watches."""

    def __init__(self, settings: TrainingSettings) -> None:
        self._settings = settings
        self._rate = 0.0
        self._last = time.perf_counter()
        self._start()

    def _start(self) -> None:
        self._count = 0
        self._began = self._last
        self._sums = dict.fromkeys(
            ("loss", "diffusion", "inverse", "inverse_accuracy", "gradient_norm"), 0.0
        )

    def add(self, losses: Losses, norm: float, now: float) -> None:
        terms = (losses.total, losses.diffusion, losses.inverse, losses.inverse_accuracy)
        values = (*(term.item() for term in terms), norm)
        for name, value in zip(self._sums, values, strict=True):
            self._sums[name] += value
        rate = self._settings.batch / max(now - self._last, 1e-9)
        self._rate = rate if self._rate == 0 else 0.95 * self._rate + 0.05 * rate
        self._count += 1
        self._last = now

    def seen(self, step: int, losses: Losses) -> Seen:
        accuracy = losses.inverse_accuracy.item()
        return Seen(step, self._settings.steps, losses.total.item(), accuracy, self._rate)

    def row(self, step: int, wall: float, rate: float) -> dict[str, float]:
        means = {name: total / self._count for name, total in self._sums.items()}
        speed = self._count * self._settings.batch / max(self._last - self._began, 1e-9)
        self._start()
        return {
            "step": step,
            "wall_s": wall,
            **means,
            "learning_rate": rate,
            "windows_per_s": speed,
        }
