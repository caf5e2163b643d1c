"""Checkpoints: the whole state of a training in one safetensors file."""

import json
from collections.abc import Set
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from tsc_missing.config import Settings
from tsc_missing.errors import UserError
from tsc_missing.files import replace_file
from tsc_missing.offline.joined import Episodes

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
    begun_from: str | None = None  # the checksum of the weights that are trained further


def write_checkpoint(path: Path, tensors: dict[str, Tensor], at: Progress) -> None:
    """Write a checkpoint, whole or not at all: the one that was there stays until then.

    Raises ``OSError`` if it cannot be written.
    """
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
    folder: Path, at: Progress, settings: Settings, resumable: Set[str], dataset: Episodes
) -> None:
    """Raise ``UserError`` where a training in ``folder`` cannot be gone on with.

    Settings that are not ``resumable`` must be as they were, and the dataset.
    """
    wanted = settings.model_dump(mode="json")
    for name in wanted.keys() - resumable:
        if name not in at.settings and type(settings).model_fields[name].is_required():
            raise UserError("out", folder, "another kind of training was begun in it")
        before = at.settings.get(name, type(settings).model_fields[name].default)
        if wanted[name] != before:
            raise UserError(name, wanted[name], f"{folder} was begun with {before}")
    if at.data != dataset.checksum:
        raise UserError("data", dataset.path, f"{folder} was begun with another dataset")
