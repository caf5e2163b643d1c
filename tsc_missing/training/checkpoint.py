"""Checkpoints: weights, their average and the optimiser's state in one safetensors file."""

import contextlib
import json
import os
from pathlib import Path
from typing import Any

import torch
from pydantic import BaseModel, ConfigDict
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from tsc_missing.diffusion.difflight import DiffLightModel
from tsc_missing.diffusion.ema import Ema
from tsc_missing.errors import UserError

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
        **_under("model", model.state_dict()),
        **_under("ema", ema.state_dict()),
        **_under("optimiser", _optimiser_tensors(model, optimiser)),
    }
    content = save(tensors, metadata={"progress": at.model_dump_json()})
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with temporary.open("wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(path)
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


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


def restore(
    path: Path,
    tensors: dict[str, Tensor],
    model: DiffLightModel,
    ema: Ema,
    optimiser: torch.optim.Optimizer,
) -> None:
    """Put a checkpoint's tensors back; ``UserError`` if they are not those of the model."""
    try:
        model.load_state_dict(_of("model", tensors))
        ema.load_state_dict(_of("ema", tensors))
        _restore_optimiser(model, optimiser, _of("optimiser", tensors))
    except (RuntimeError, KeyError):
        raise UserError(FIELD, path, "its tensors are not those of its model") from None


def _optimiser_tensors(
    model: DiffLightModel, optimiser: torch.optim.Optimizer
) -> dict[str, Tensor]:
    return {
        f"{name}/{key}": value
        for name, weight in model.named_parameters()
        for key, value in optimiser.state.get(weight, {}).items()
    }


def _restore_optimiser(
    model: DiffLightModel, optimiser: torch.optim.Optimizer, tensors: dict[str, Tensor]
) -> None:
    weights = dict(model.named_parameters())
    for full, value in tensors.items():
        name, key = full.rsplit("/", 1)
        optimiser.state[weights[name]][key] = value


def _under(part: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    return {f"{part}/{name}": tensor.contiguous().clone() for name, tensor in tensors.items()}


def _of(part: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    start = f"{part}/"
    return {name.removeprefix(start): t for name, t in tensors.items() if name.startswith(start)}
