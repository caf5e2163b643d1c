"""The training of a baseline."""

import math
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
from tsc_missing.offline.dataset import Dataset
from tsc_missing.seeding import stream
from tsc_missing.training.config import RESUMABLE
from tsc_missing.training.diverged import DivergedError
from tsc_missing.training.metrics import MetricsLog
from tsc_missing.training.steps import StepTraining, learning_rate
from tsc_missing.versions import git_revision, versions
from tsc_missing.weights.find import FILE
from tsc_missing.weights.state import optimiser_state, part_of, restore_optimiser, under


@dataclass(frozen=True)
class Seen:
    """The state of a training for who watches it."""

    step: int
    steps: int
    logged: dict[str, float]  # of the last update


class BaselineTraining(StepTraining[BaselineSettings, Seen]):
    """A training in a folder: metrics, a checkpoint, in the end the weights."""

    def __init__(
        self, settings: BaselineSettings, dataset: Dataset, folder: Path, resume: bool = False
    ) -> None:
        """Check everything that can be wrong, and load the checkpoint to resume from."""
        super().__init__(settings, dataset, folder)
        self._since: list[dict[str, float]] = []  # what the steps since the last row logged
        self.learner = make_learner(settings)
        if not (dataset.manifest.complete or self.learner.takes_holes):
            raise UserError(
                "data", dataset.path, f"its logs have holes, and {settings.algorithm} needs all"
            )
        self._begin(resume, RESUMABLE)
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

    def _prepare(self) -> None:
        self.learner.prepare(self._logs)

    def _advance(self) -> Seen:
        self._since.append(self.train_step())
        return Seen(self.step, self.settings.steps, self._since[-1])

    def _open_log(self) -> MetricsLog:
        """The table of a training that logs what it does; rows of steps that are done stay."""
        held = (f"held_out_{name}" for name in self.held_out())
        columns = ("step", "wall_s", *self._since[-1], *held, "learning_rate")
        return MetricsLog(self.folder, self.step - 1, columns)

    def _row(self) -> dict[str, float]:
        since, self._since = self._since, []
        means = {name: _mean([(1, logged[name]) for logged in since]) for name in since[0]}
        held = {f"held_out_{name}": value for name, value in self.held_out().items()}
        return {**means, **held, "learning_rate": learning_rate(self.settings, self.step - 1)}

    def _tensors(self) -> dict[str, Tensor]:
        tensors = under("learner", self.learner.state_dict())
        for name, optimiser in self.learner.optimisers.items():
            tensors |= under(name, optimiser_state(self.learner, optimiser))
        return tensors

    def _restore(self, tensors: dict[str, Tensor]) -> None:
        self.learner.load_state_dict(part_of("learner", tensors))
        for name, optimiser in self.learner.optimisers.items():
            restore_optimiser(self.learner, optimiser, part_of(name, tensors))

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
