"""Weights files: safetensors with a manifest, whole or refused in one line."""

import contextlib
import hashlib
import json
import os
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from tsc_missing.diffusion.config import DiffLightConfig
from tsc_missing.diffusion.difflight import DiffLightModel
from tsc_missing.errors import UserError
from tsc_missing.files import first_problem

VERSION = 1  # of the file and of what its tensors mean
FIELD = "weights"


def save_weights(model: DiffLightModel, path: Path, about: dict[str, Any]) -> None:
    """Write the model's weights and a manifest: version, config, checksum, and ``about``.

    ``about`` (JSON values) tells where they come from: data, seed, steps, wall time. The file
    appears whole or not at all.
    """
    tensors = {name: tensor.contiguous() for name, tensor in model.state_dict().items()}
    manifest = {
        **about,
        "version": VERSION,
        "config": model.config.model_dump(mode="json"),
        "checksum": checksum(tensors),
    }
    content = save(tensors, metadata={"manifest": json.dumps(manifest, sort_keys=True)})
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        temporary.write_bytes(content)
        temporary.replace(path)
    except OSError as error:
        raise UserError(FIELD, path, f"cannot be written ({error.strerror})") from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def load_weights(path: Path) -> tuple[DiffLightModel, dict[str, Any]]:
    """The model of a weights file, in evaluation mode, and its manifest.

    Raises ``UserError`` for a file that is not there, cut off, of another version or changed.
    """
    manifest, tensors = _read(path)
    if manifest.get("version") != VERSION:
        found = manifest.get("version")
        raise UserError(FIELD, path, f"it has version {found}, and this program reads {VERSION}")
    try:
        config = DiffLightConfig.model_validate(manifest.get("config"))
    except ValidationError as error:
        raise UserError(FIELD, path, f"its config is not valid: {first_problem(error)}") from None
    if checksum(tensors) != manifest.get("checksum"):
        raise UserError(FIELD, path, "its checksum is wrong: the file was changed or damaged")
    model = DiffLightModel(config)
    try:
        model.load_state_dict(tensors)
    except RuntimeError:
        raise UserError(FIELD, path, "its tensors are not those of its config") from None
    return model.requires_grad_(False).eval(), manifest


def _read(path: Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    try:
        with safe_open(path, framework="pt") as file:
            manifest = json.loads((file.metadata() or {})["manifest"])
            return manifest, {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except OSError as error:
        reason = error.strerror or "no such file"
        raise UserError(FIELD, path, f"the file cannot be read ({reason})") from None
    except (SafetensorError, KeyError, ValueError):
        raise UserError(FIELD, path, "not a weights file, or cut off") from None


def checksum(tensors: dict[str, Tensor]) -> str:
    """SHA-256 over names, shapes and values."""
    digest = hashlib.sha256()
    for name in sorted(tensors):
        digest.update(f"{name} {list(tensors[name].shape)} {tensors[name].dtype}".encode())
        digest.update(tensors[name].contiguous().numpy().tobytes())
    return digest.hexdigest()
