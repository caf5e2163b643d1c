"""The state of a training by Q-learning, between two rounds."""

from pathlib import Path

from torch import Tensor

from tsc_missing.errors import UserError
from tsc_missing.qlearning.config import QLearningSettings
from tsc_missing.qlearning.learner import Learner
from tsc_missing.weights.file import read_tensors, write_tensors
from tsc_missing.weights.state import optimiser_state, part_of, restore_optimiser, under

KIND = "q-training"
CHECKPOINT = "checkpoint.safetensors"
FIELD = "checkpoint"


def save_learner(folder: Path, settings: QLearningSettings, learner: Learner, rounds: int) -> None:
    """Write network, target and optimiser, whole or not at all."""
    manifest = {
        "settings": settings.model_dump(mode="json"),
        "rounds": rounds,
        "updates": learner.done,
    }
    write_tensors(folder / CHECKPOINT, KIND, _tensors(learner), manifest)


def load_learner(folder: Path, settings: QLearningSettings, learner: Learner) -> int:
    """Put a checkpoint back; returns the rounds that are done.

    Raises ``UserError`` if it is none, or of a training with other settings.
    """
    path = folder / CHECKPOINT
    manifest, tensors = read_tensors(path, KIND)
    before, wanted = manifest["settings"], settings.model_dump(mode="json")
    for name in wanted:
        if wanted[name] != before.get(name):
            raise UserError(name, wanted[name], f"{folder} was begun with {before.get(name)}")
    learner.network.load_state_dict(part_of("network", tensors))
    learner.target.load_state_dict(part_of("target", tensors))
    learner.acting.load_state_dict(part_of("acting", tensors))
    restore_optimiser(learner.network, learner.optimiser, part_of("optimiser", tensors))
    learner.done = int(manifest["updates"])
    return int(manifest["rounds"])


def _tensors(learner: Learner) -> dict[str, Tensor]:
    parts = {
        "network": learner.network.state_dict(),
        "target": learner.target.state_dict(),
        "acting": learner.acting.state_dict(),
        "optimiser": optimiser_state(learner.network, learner.optimiser),
    }
    return {
        name: tensor
        for part, tensors in parts.items()
        for name, tensor in under(part, tensors).items()
    }
