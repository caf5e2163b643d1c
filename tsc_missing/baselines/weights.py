"""The weights files of baselines."""

from pathlib import Path
from typing import Any

import torch
from pydantic import ValidationError

from tsc_missing.baselines.base import Policy
from tsc_missing.baselines.config import BaselineSettings, settings_class
from tsc_missing.baselines.registry import make_learner
from tsc_missing.errors import UserError
from tsc_missing.qlearning.features import NAMES
from tsc_missing.weights.file import read_tensors, write_tensors
from tsc_missing.weights.find import FIELD

KIND = "baseline"


def save_policy(
    policy: Policy, settings: BaselineSettings, path: Path, about: dict[str, Any]
) -> None:
    """Write a policy's weights and a manifest: what it is, and ``about`` (JSON values)."""
    manifest = {
        **about,
        "algorithm": settings.algorithm,
        "training": settings.model_dump(mode="json", exclude={"data"}),
        "features": list(NAMES),
    }
    write_tensors(path, KIND, policy.state_dict(), manifest)


def load_policy(path: Path) -> tuple[Policy, BaselineSettings, dict[str, Any]]:
    """The policy of a weights file, in evaluation mode, its settings and its manifest.

    Raises ``UserError`` for a file that is not there, cut off, of another version or changed.
    """
    manifest, tensors = read_tensors(path, KIND)
    if manifest.get("features") != list(NAMES):
        raise UserError(FIELD, path, "it was trained on other features than this program has")
    found = settings_class(manifest.get("algorithm"))
    if found is None:
        raise UserError(FIELD, path, f"this program knows no baseline {manifest.get('algorithm')}")
    try:
        settings = found.model_validate({**manifest["training"], "data": "."})
        with torch.random.fork_rng(devices=[]):
            policy = make_learner(settings).policy
        policy.load_state_dict(tensors)
    except (KeyError, TypeError, RuntimeError, ValidationError):
        raise UserError(FIELD, path, "its tensors are not those of its algorithm") from None
    return policy.requires_grad_(False).eval(), settings, manifest
