"""What a training is: one TOML file."""

import tomllib
from pathlib import Path
from typing import Annotated, Any, get_args

from pydantic import Field, ValidationError

from tsc_missing.baselines.config import SETTINGS, BaselineSettings, settings_class
from tsc_missing.diffusion.config import DiffLightConfig, Precision
from tsc_missing.errors import UserError, nearest
from tsc_missing.files import first_problem
from tsc_missing.lookahead.config import LookaheadSettings
from tsc_missing.offline.window_masks import MaskMix
from tsc_missing.paths import bundled
from tsc_missing.qlearning.config import Algorithm, QLearningSettings
from tsc_missing.training.step_settings import StepSettings

FIELD = "config"
LOOKAHEAD = "lookahead"


Paths = Annotated[tuple[Path, ...], Field(min_length=1)]


class TrainingSettings(StepSettings):
    """Everything that the weights of a training depend on, and how often it is saved."""

    data: Path | Paths  # the dataset's folder, or those of several, learned as one
    begin: str = ""  # weights that are trained further, a name or a path; none: fresh ones
    model: DiffLightConfig = DiffLightConfig()
    masks: MaskMix = MaskMix()
    told_all: float = Field(0.5, ge=0, le=1)  # share of windows whose neighbours tell everything

    batch: int = Field(1024, ge=1)  # [windows]
    weight_decay: float = Field(1e-4, ge=0)
    ema_decay: float = Field(0.999, ge=0, lt=1)
    precision: Precision = "bfloat16"

    resident: int = Field(128, ge=1)  # episodes in memory at a time
    renew: int = Field(4, ge=1)  # steps after which one of them is exchanged


RESUMABLE = frozenset({"data", "log_steps", "checkpoint_seconds"})
"""Settings that may differ where a training is gone on with: they do not change the weights."""


def read_training(
    config: str, **changes: Any
) -> TrainingSettings | QLearningSettings | LookaheadSettings | BaselineSettings:
    """The settings of a TOML file, or of a bundled one by its name, with ``changes`` put in.

    A file that names an ``algorithm`` is one of Q-learning, of lookahead or of a baseline. Raises
    ``UserError`` for a file that is not there, no TOML, or has something unknown.
    """
    path = find_config(config)
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UserError(FIELD, path, f"the file cannot be read ({error.strerror})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UserError(FIELD, path, f"not valid TOML: {error}") from None
    kind = _kind(values, path)
    for name, value in changes.items():
        if name not in kind.model_fields:
            raise UserError(name, value, f"the training {path.stem} has no such setting")
        if isinstance(value, list) and kind is not TrainingSettings:
            words = f"the training {path.stem} learns from one dataset"
            raise UserError(name, " and ".join(map(str, value)), words)
    try:
        return kind.model_validate({**values, **changes})
    except ValidationError as error:
        for wrong in error.errors():
            if wrong["loc"] and (name := str(wrong["loc"][0])) in changes:
                raise UserError(name, changes[name], wrong["msg"]) from None
        raise UserError(FIELD, path, first_problem(error, kind)) from None


def _kind(
    values: dict[str, Any], path: Path
) -> (
    type[TrainingSettings]
    | type[QLearningSettings]
    | type[LookaheadSettings]
    | type[BaselineSettings]
):
    """The settings that a file's ``algorithm`` means; without one, the diffusion model's."""
    if "algorithm" not in values:
        return TrainingSettings
    name = values["algorithm"]
    if name in get_args(Algorithm):
        return QLearningSettings
    if name == LOOKAHEAD:
        return LookaheadSettings
    found = settings_class(name)
    if found is None:
        known = (*SETTINGS, *get_args(Algorithm), LOOKAHEAD)
        words = f"at algorithm: found {str(name)[:60]!r}; {nearest(str(name), known)}"
        raise UserError(FIELD, path, words)
    return found


def find_config(config: str) -> Path:
    """The file of a path, or of the name of a bundled training."""
    named = bundled("scenarios") / "training" / f"{config}.toml"
    return named if not Path(config).exists() and named.is_file() else Path(config)
