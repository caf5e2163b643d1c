"""A training of many steps in a folder: metrics, checkpoints, in the end the weights.

The same weights come out whether it ran through or was stopped and resumed: all that is random at
a step depends on the seed and the step's number.
"""

import contextlib
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Set
from pathlib import Path
from typing import Generic, TypeVar

import torch
from torch import Tensor

from tsc_missing.errors import UserError
from tsc_missing.files import KEPT, check_begun_training, check_new_training, written_into
from tsc_missing.offline.joined import Episodes
from tsc_missing.seeding import stream
from tsc_missing.training import checkpoint
from tsc_missing.training.metrics import MetricsLog
from tsc_missing.training.step_settings import StepSettings

P = TypeVar("P", bound=StepSettings)
S = TypeVar("S")  # the state of a training for who watches it


class StoppedError(Exception):
    """The training was asked to stop; ``step`` is the checkpoint's."""

    def __init__(self, step: int) -> None:
        """Nothing is lost."""
        self.step = step
        super().__init__(f"stopped at step {step}")


class StepTraining(ABC, Generic[P, S]):
    """What the trainings have in common; a subclass makes its model between the two calls here.

    ``__init__`` seeds torch for fresh weights; ``_begin`` then loads the checkpoint to resume from.
    """

    def __init__(self, settings: P, dataset: Episodes, folder: Path) -> None:
        """Nothing is checked yet."""
        self.folder = folder
        self.step = 0
        self.settings = settings
        self._dataset = dataset
        self._wall = 0.0
        self._begun_from: str | None = None  # the checksum of weights that are trained further
        torch.manual_seed(int(stream(settings.seed, "weights").integers(2**31)))

    @property
    def checkpoint(self) -> Path:
        """The file."""
        return self.folder / checkpoint.FILE

    def _begin(self, resume: bool, resumable: Set[str]) -> None:
        """Go on from the checkpoint, or see that the folder is new; ``UserError`` if it cannot be.

        Settings that are not ``resumable`` must be as they were.
        """
        if not resume:
            check_new_training(self.folder)
            return
        check_begun_training(self.folder, checkpoint.FILE)
        at, tensors = checkpoint.load_checkpoint(self.checkpoint)
        checkpoint.check_same(self.folder, at, self.settings, resumable, self._dataset)
        try:
            self._restore(tensors)
        except (RuntimeError, KeyError):
            words = "its tensors are not those of its model"
            raise UserError(checkpoint.FIELD, self.checkpoint, words) from None
        self.step, self._wall = at.step, at.wall_seconds
        self._begun_from = at.begun_from

    def run(
        self, watch: Callable[[S], None] | None = None, stop: Callable[[], bool] = lambda: False
    ) -> Path:
        """Train to the last step and write the weights; returns their file.

        ``stop`` is asked after every step: once it is true the state is saved, and ``StoppedError``
        raised. A full disk raises ``UserError``: the last checkpoint is whole.
        """
        began = time.perf_counter() - self._wall
        with written_into(self.folder, "out", KEPT):
            self.folder.mkdir(parents=True, exist_ok=True)
            self._loop(began, watch, stop)
            self._save(time.perf_counter() - began)
            return self._write_weights()

    def _loop(
        self, began: float, watch: Callable[[S], None] | None, stop: Callable[[], bool]
    ) -> None:
        if self.step == 0:
            self._prepare()
            self._save(0.0)
        saved = time.perf_counter()
        with contextlib.ExitStack() as stack:
            log: MetricsLog | None = None
            while self.step < self.settings.steps:
                seen = self._advance()
                log = log or stack.enter_context(contextlib.closing(self._open_log()))
                if watch is not None:
                    watch(seen)
                if self.step % self.settings.log_steps == 0 or self.step == self.settings.steps:
                    at = {"step": self.step, "wall_s": time.perf_counter() - began}
                    log.write({**at, **self._row()})
                stopping = stop()
                now = time.perf_counter()
                if stopping or now - saved >= self.settings.checkpoint_seconds:
                    self._save(now - began)
                    saved = now
                if stopping:
                    raise StoppedError(self.step)

    def _save(self, wall_seconds: float) -> None:
        self._wall = wall_seconds
        at = checkpoint.Progress(
            step=self.step,
            wall_seconds=wall_seconds,
            settings=self.settings.model_dump(mode="json"),
            data=self._dataset.checksum,
            begun_from=self._begun_from,
        )
        checkpoint.write_checkpoint(self.checkpoint, self._tensors(), at)

    def _prepare(self) -> None:
        """What is done once, before the first step."""

    @abstractmethod
    def _advance(self) -> S:
        """Take a step; what who watches sees of it. Raises ``DivergedError``."""

    @abstractmethod
    def _open_log(self) -> MetricsLog:
        """The table of metrics, after the first step."""

    @abstractmethod
    def _row(self) -> dict[str, float]:
        """What the table says of the steps since the last row, besides step and time."""

    @abstractmethod
    def _tensors(self) -> dict[str, Tensor]:
        """The whole state."""

    @abstractmethod
    def _restore(self, tensors: dict[str, Tensor]) -> None:
        """Put a state back; ``RuntimeError`` or ``KeyError`` if it is not of this model."""

    @abstractmethod
    def _write_weights(self) -> Path:
        """Write the result; returns its file."""


def learning_rate(settings: StepSettings, step: int) -> float:
    """A rise over ``warm_up`` steps, then half a cosine from the highest to the final rate."""
    rise = min(1.0, (step + 1) / (settings.warm_up + 1))
    part = min(1.0, step / settings.steps)
    low, high = settings.final_learning_rate, settings.learning_rate
    return rise * (low + (high - low) * (1 + math.cos(math.pi * part)) / 2)
