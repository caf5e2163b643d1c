"""The weights files of the diffusion model."""

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from tsc_missing.diffusion.config import DiffLightConfig
from tsc_missing.diffusion.difflight import DiffLightModel
from tsc_missing.errors import UserError
from tsc_missing.files import first_problem
from tsc_missing.weights.file import read_tensors, write_tensors
from tsc_missing.weights.find import FIELD

KIND = "difflight"


def save_weights(model: DiffLightModel, path: Path, about: dict[str, Any]) -> None:
    """Write the model's weights and a manifest: config, and ``about``.

    ``about`` (JSON values) tells where they come from: data, seed, steps, wall time. The file
    appears whole or not at all.
    """
    config = model.config.model_dump(mode="json")
    write_tensors(path, KIND, model.state_dict(), {**about, "config": config})


def load_weights(path: Path) -> tuple[DiffLightModel, dict[str, Any]]:
    """The model of a weights file, in evaluation mode, and its manifest.

    Raises ``UserError`` for a file that is not there, cut off, of another version or changed.
    """
    manifest, tensors = read_tensors(path, KIND)
    try:
        config = DiffLightConfig.model_validate(manifest.get("config"))
    except ValidationError as error:
        words = f"its config is not valid: {first_problem(error, DiffLightConfig)}"
        raise UserError(FIELD, path, words) from None
    model = DiffLightModel(config)
    try:
        model.load_state_dict(tensors)
    except RuntimeError:
        raise UserError(FIELD, path, "its tensors are not those of its config") from None
    return model.requires_grad_(False).eval(), manifest
