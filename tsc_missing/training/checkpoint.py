"""Checkpoints: weights, their average and the optimiser's state in one safetensors file."""

import json
from collections.abc import Set
from pathlib import Path
from typing import Any

import torch
from pydantic import BaseModel, ConfigDict
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from tsc_missing.config import Settings
from tsc_missing.diffusion.difflight import DiffLightModel
from tsc_missing.diffusion.ema import Ema
from tsc_missing.errors import UserError
from tsc_missing.files import replace_file
from tsc_missing.offline.dataset import Dataset
from tsc_missing.weights.state import optimiser_state, part_of, restore_optimiser, under

FIELD = "checkpoint"
FILE = "checkpoint.safetensors"


class Progress(BaseModel):
    """Where a training is, and what it is of."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: int = 1
    step: int  # optimiser steps taken
    wall_seconds: float  # spent in all
    settings: dict[str, Any]
    data: str  # the dataset's checksum


def save_checkpoint(
    path: Path, model: DiffLightModel, ema: Ema, optimiser: torch.optim.Optimizer, at: Progress
) -> None:
    """Write a checkpoint, whole or not at all: the one that was there stays until then.

    Raises ``OSError`` if it cannot be written.
    """
    tensors = {
        **under("model", model.state_dict()),
        **under("ema", ema.state_dict()),
        **under("optimiser", optimiser_state(model, optimiser)),
    }
    write_checkpoint(path, tensors, at)


def write_checkpoint(path: Path, tensors: dict[str, Tensor], at: Progress) -> None:
    """Write a checkpoint's file of any tensors; raises as ``save_checkpoint`` does."""
    replace_file(path, save(tensors, metadata={"progress": at.model_dump_json()}))


def load_checkpoint(path: Path) -> tuple[Progress, dict[str, Tensor]]:
    """The progress and the tensors of a checkpoint; ``UserError`` if it is none."""
    try:
        with safe_open(path, framework="pt") as file:
            value = json.loads((file.metadata() or {})["progress"])
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        if value["format"] != 1:
            found = value["format"]
            raise UserError(FIELD, path, f"it has format {found}, and this program reads 1")
        return Progress.model_validate(value), tensors
    except OSError as error:
        reason = error.strerror or "no such file"
        raise UserError(FIELD, path, f"the file cannot be read ({reason})") from None
    except (SafetensorError, KeyError, ValueError):
        raise UserError(FIELD, path, "not a checkpoint, or cut off") from None


def check_same(
    folder: Path, at: Progress, settings: Settings, resumable: Set[str], dataset: Dataset
) -> None:
    """Raise ``UserError`` where a training in ``folder`` cannot be gone on with.

    Settings that are not ``resumable`` must be as they were, and the dataset.
    """
    wanted = settings.model_dump(mode="json")
    for name in wanted.keys() - resumable:
        before = at.settings.get(name)
        if wanted[name] != before:
            raise UserError(name, wanted[name], f"{folder} was begun with {before}")
    if at.data != dataset.checksum:
        raise UserError("data", dataset.path, f"{folder} was begun with another dataset")


def restore(
    path: Path,
    tensors: dict[str, Tensor],
    model: DiffLightModel,
    ema: Ema,
    optimiser: torch.optim.Optimizer,
) -> None:
    """Put a checkpoint's tensors back; ``UserError`` if they are not those of the model."""
    try:
        model.load_state_dict(part_of("model", tensors))
        ema.load_state_dict(part_of("ema", tensors))
        restore_optimiser(model, optimiser, part_of("optimiser", tensors))
    except (RuntimeError, KeyError):
        raise UserError(FIELD, path, "its tensors are not those of its model") from None
