"""Weights files: safetensors with a manifest, whole or refused in one line."""

import hashlib
import json
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from tsc_missing.errors import UserError
from tsc_missing.files import replace_file
from tsc_missing.weights.find import FIELD

VERSION = 1  # of the file and of what its tensors mean


def write_tensors(
    path: Path, kind: str, tensors: dict[str, Tensor], manifest: dict[str, Any]
) -> None:
    """Write tensors and a manifest: ``manifest`` with the kind, the version and a checksum.

    The file appears whole or not at all.
    """
    tensors = {name: tensor.contiguous() for name, tensor in tensors.items()}
    whole = {**manifest, "kind": kind, "version": VERSION, "checksum": checksum(tensors)}
    content = save(tensors, metadata={"manifest": json.dumps(whole, sort_keys=True)})
    try:
        replace_file(path, content)
    except OSError as error:
        raise UserError(FIELD, path, f"cannot be written ({error.strerror})") from error


def read_tensors(path: Path, kind: str) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """The manifest and the tensors of a file of this kind.

    Raises ``UserError`` for one that is not there, cut off, changed, of another version or kind.
    """
    manifest, tensors = _read(path)
    if manifest.get("version") != VERSION:
        found = manifest.get("version")
        raise UserError(FIELD, path, f"it has version {found}, and this program reads {VERSION}")
    if manifest.get("kind") != kind:
        raise UserError(FIELD, path, f"weights of kind {manifest.get('kind')}, not {kind}")
    if checksum(tensors) != manifest.get("checksum"):
        raise UserError(FIELD, path, "its checksum is wrong: the file was changed or damaged")
    return manifest, tensors


def _read(path: Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    try:
        with safe_open(path, framework="pt") as file:
            manifest = dict(json.loads((file.metadata() or {})["manifest"]))
            return manifest, {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except OSError as error:
        reason = error.strerror or "no such file"
        raise UserError(FIELD, path, f"the file cannot be read ({reason})") from None
    except (SafetensorError, KeyError, ValueError, TypeError):
        raise UserError(FIELD, path, "not a weights file, or cut off") from None


def checksum(tensors: dict[str, Tensor]) -> str:
    """SHA-256 over names, shapes and values."""
    digest = hashlib.sha256()
    for name in sorted(tensors):
        digest.update(f"{name} {list(tensors[name].shape)} {tensors[name].dtype}".encode())
        digest.update(tensors[name].contiguous().numpy().tobytes())
    return digest.hexdigest()
