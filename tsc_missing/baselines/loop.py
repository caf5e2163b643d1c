"""The training of a baseline: the same weights whether it ran through or was stopped and resumed.

All that is random at a step depends on the seed and the step's number.
"""

import contextlib
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from tsc_missing.baselines.base import NotFiniteError
from tsc_missing.baselines.config import BaselineSettings
from tsc_missing.baselines.registry import make_learner
from tsc_missing.baselines.transitions import read_logs
from tsc_missing.baselines.weights import save_policy
from tsc_missing.errors import UserError
from tsc_missing.files import check_new_training
from tsc_missing.offline.dataset import Dataset
from tsc_missing.seeding import stream
from tsc_missing.training import checkpoint
from tsc_missing.training.config import RESUMABLE
from tsc_missing.training.loop import DivergedError, StoppedError, learning_rate
from tsc_missing.training.metrics import MetricsLog
from tsc_missing.versions import git_revision, versions
from tsc_missing.weights.find import FILE
from tsc_missing.weights.state import optimiser_state, part_of, restore_optimiser, under


@dataclass(frozen=True)
class Seen:
    """The state of a training for who watches it."""

    step: int
    steps: int
    logged: dict[str, float]  # of the last update


Watch = Callable[[Seen], None]


class BaselineTraining:
    """A training in a folder: metrics, a checkpoint, in the end the weights."""

    def __init__(
        self, settings: BaselineSettings, dataset: Dataset, folder: Path, resume: bool = False
    ) -> None:
        """Check everything that can be wrong, and load the checkpoint to resume from."""
        self.settings = settings
        self.folder = folder
        self.step = 0
        self._dataset = dataset
        self._wall = 0.0
        torch.manual_seed(int(stream(settings.seed, "weights").integers(2**31)))
        self.learner = make_learner(settings)
        if not (dataset.manifest.complete or self.learner.takes_holes):
            raise UserError(
                "data", dataset.path, f"its logs have holes, and {settings.algorithm} needs all"
            )
        if resume:
            self._resume()
        else:
            check_new_training(folder)
        learner = self.learner
        self._logs, self._held_out = read_logs(
            dataset, settings, learner.length, learner.padded, learner.ahead, learner.discount
        )
        if self.learner.takes_holes and not self._logs.rewards:
            raise UserError(
                "data",
                dataset.path,
                "no intersection reported all its slots at two successive steps, so there is no "
                "reward to learn from",
            )

    def run(self, watch: Watch | None = None, stop: Callable[[], bool] = lambda: False) -> Path:
        """Train to the last step and write the weights; returns their file.

        ``stop`` is asked after every step: once it is true the state is saved, and ``StoppedError``
        raised. A full disk raises ``UserError``: the last checkpoint is whole.
        """
        began = time.perf_counter() - self._wall
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._loop(began, watch, stop)
            self._save(time.perf_counter() - began)
            return self._write_weights()
        except OSError as error:
            raise UserError(
                "out",
                self.folder,
                f"cannot be written ({error.strerror}); the last checkpoint is whole, and "
                "--resume goes on from it",
            ) from error

    def held_out(self) -> dict[str, float]:
        """What the learner tells of the episodes that it does not learn from."""
        noise = int(stream(self.settings.seed, "held-out").integers(2**63))
        generator = torch.Generator().manual_seed(noise)
        parts: list[tuple[int, dict[str, float]]] = []
        self.learner.eval()
        with torch.inference_mode():
            for batch in self._held_out.spread():
                parts.append((batch.samples, self.learner.held_out(batch, generator)))
        return {name: _mean([(n, found[name]) for n, found in parts]) for name in parts[0][1]}

    def train_step(self) -> dict[str, float]:
        """One update; what the learner logs of it. Raises ``DivergedError``."""
        seed, step = self.settings.seed, self.step
        batch = self._logs.sample(self.settings.batch, stream(seed, f"batch-{step}"))
        noise = int(stream(seed, f"noise-{step}").integers(2**63))
        rate = learning_rate(self.settings, step)
        for optimiser in self.learner.optimisers.values():
            for group in optimiser.param_groups:
                group["lr"] = rate
        self.learner.train()
        try:
            logged = self.learner.update(batch, step, torch.Generator().manual_seed(noise))
        except NotFiniteError as error:
            raise DivergedError(f"at step {step} {error}; no weights were written") from None
        self.step += 1
        return logged

    def _loop(self, began: float, watch: Watch | None, stop: Callable[[], bool]) -> None:
        if self.step == 0:
            self.learner.prepare(self._logs)
            self._save(0.0)
        saved = time.perf_counter()
        with contextlib.ExitStack() as stack:
            log: MetricsLog | None = None
            since: list[dict[str, float]] = []
            while self.step < self.settings.steps:
                since.append(self.train_step())
                log = log or stack.enter_context(self._log(since[-1]))
                if watch is not None:
                    watch(Seen(self.step, self.settings.steps, since[-1]))
                if self.step % self.settings.log_steps == 0 or self.step == self.settings.steps:
                    log.write(self._row(since, time.perf_counter() - began))
                    since.clear()
                stopping = stop()
                now = time.perf_counter()
                if stopping or now - saved >= self.settings.checkpoint_seconds:
                    self._save(now - began)
                    saved = now
                if stopping:
                    raise StoppedError(self.step)

    @contextlib.contextmanager
    def _log(self, logged: dict[str, float]) -> Iterator[MetricsLog]:
        """The table of a training that logs this; rows of steps that are done stay."""
        held = (f"held_out_{name}" for name in self.held_out())
        columns = ("step", "wall_s", *logged, *held, "learning_rate")
        log = MetricsLog(self.folder, self.step - 1, columns)
        with contextlib.closing(log):
            yield log

    def _row(self, since: list[dict[str, float]], wall: float) -> dict[str, float]:
        means = {name: _mean([(1, logged[name]) for logged in since]) for name in since[0]}
        held = {f"held_out_{name}": value for name, value in self.held_out().items()}
        rate = learning_rate(self.settings, self.step - 1)
        return {"step": self.step, "wall_s": wall, **means, **held, "learning_rate": rate}

    def _save(self, wall_seconds: float) -> None:
        self._wall = wall_seconds
        at = checkpoint.Progress(
            step=self.step,
            wall_seconds=wall_seconds,
            settings=self.settings.model_dump(mode="json"),
            data=self._dataset.checksum,
        )
        checkpoint.write_checkpoint(self.folder / checkpoint.FILE, self._tensors(), at)

    def _tensors(self) -> dict[str, Tensor]:
        tensors = under("learner", self.learner.state_dict())
        for name, optimiser in self.learner.optimisers.items():
            tensors |= under(name, optimiser_state(self.learner, optimiser))
        return tensors

    def _resume(self) -> None:
        path = self.folder / checkpoint.FILE
        at, tensors = checkpoint.load_checkpoint(path)
        checkpoint.check_same(self.folder, at, self.settings, RESUMABLE, self._dataset)
        try:
            self.learner.load_state_dict(part_of("learner", tensors))
            for name, optimiser in self.learner.optimisers.items():
                restore_optimiser(self.learner, optimiser, part_of(name, tensors))
        except (RuntimeError, KeyError):
            words = "its tensors are not those of its algorithm"
            raise UserError(checkpoint.FIELD, path, words) from None
        self.step, self._wall = at.step, at.wall_seconds

    def _write_weights(self) -> Path:
        path = self.folder / FILE
        about = {
            "data": self._dataset.about(),
            "seed": self.settings.seed,
            "steps": self.step,
            "wall_seconds": round(self._wall, 3),
            "held_out": self.held_out(),
            "versions": versions(),
            "git": git_revision(),
        }
        save_policy(self.learner.policy, self.settings, path, about)
        return path


def _mean(parts: list[tuple[int, float]]) -> float:
    """The mean of numbers with weights, those that are NaN left out; NaN where all are."""
    there = [(weight, value) for weight, value in parts if not math.isnan(value)]
    total = sum(weight for weight, _ in there)
    return sum(weight * value for weight, value in there) / total if there else math.nan
