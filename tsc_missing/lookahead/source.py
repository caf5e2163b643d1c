"""The episodes of a training by lookahead, wherever they are."""

from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from tsc_missing.errors import UserError
from tsc_missing.files import read_json
from tsc_missing.lookahead.config import LookaheadSettings

EPISODES, SETTINGS = "episodes", "settings.json"
SAME = ("depth", "discount", "running_weight", "reward_scale", "horizon")  # what returns depend on


@dataclass(frozen=True)
class Source:
    """A training's folder and what its episodes are."""

    folder: Path
    settings: LookaheadSettings

    def path(self, number: int) -> Path:
        """The file of an episode."""
        return self.folder / EPISODES / f"{number:05d}.safetensors"

    def net(self, number: int) -> str:
        """The network of an episode."""
        return self.settings.nets[number % len(self.settings.nets)]

    @property
    def missing(self) -> list[int]:
        """The episodes that are not there yet."""
        return [k for k in range(self.settings.episodes) if not self.path(k).is_file()]

    def is_held_out(self, number: int) -> bool:
        """Whether the episode only measures what was learned."""
        return number >= self.settings.episodes - self.settings.held_out


def read_settings(folder: Path, field: str) -> LookaheadSettings:
    """What a training was begun with; those that it did not have yet are as by default.

    ``field`` is what the ``UserError`` for a folder that is none names.
    """
    try:
        return LookaheadSettings.model_validate(read_json(folder / SETTINGS, field))
    except ValidationError:
        raise UserError(field, folder, "its settings are not those of lookahead") from None


def read_source(folder: Path, like: LookaheadSettings) -> Source:
    """The episodes of another training, to be learned from with those of ``like``.

    Raises ``UserError`` where some are missing or mean something else.
    """
    settings = read_settings(folder, "also")
    source = Source(folder, settings)
    if source.missing:
        raise UserError("also", folder, f"{len(source.missing)} of its episodes are not there")
    for name in SAME:
        found, wanted = getattr(settings, name), getattr(like, name)
        if found != wanted:
            raise UserError("also", folder, f"its {name} must be {wanted}, found {found}")
    return source
