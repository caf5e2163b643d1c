"""What a training by lookahead is: one TOML file."""

from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from tsc_missing.config import Settings
from tsc_missing.qlearning.features import MOST_HISTORY
from tsc_missing.sensing.failures import Failure, MaybeFailure

LEARNING = frozenset(
    {"episodes", "held_out", "history", "updates", "batch", "learning_rate", "weight_decay"}
    | {"average", "complete"}
)
"""Settings that may differ where a training is gone on with: its episodes stay what they are."""


class LookaheadSettings(Settings):
    """Everything that the weights depend on."""

    algorithm: Literal["lookahead"] = "lookahead"
    nets: tuple[str, ...] = Field(min_length=1)  # names or network folders, taken in turn
    demand: Literal["auto", "profile", "recorded"] = "profile"
    volume_min: float = Field(0.7, gt=0, le=10)  # times the arrivals, where a profile gives them,
    volume_max: float = Field(1.3, gt=0, le=10)  # drawn for each episode
    horizon: int = Field(3600, gt=0)  # [s] of an episode

    base: str = "value"  # weights that decide in the episodes, and that are improved
    min_space: int = Field(0, ge=0)  # [vehicles a lane] kept free on short roads meanwhile; 0: none
    lost: tuple[MaybeFailure, ...] = ("none",)  # in the episodes, in turn: then
    # `fill` and `base` decide together, as the diffusion controller does
    episodes: int = Field(30, ge=1)
    held_out: int = Field(0, ge=0)  # of them, the last: only to measure what was learned
    tried: float = Field(1 / 3, gt=0, le=1)  # share of the decision steps at which phases are tried
    depth: int = Field(4, ge=1)  # [decision steps] simulated with each phase
    epsilon_min: float = Field(0.02, ge=0, le=1)  # share of random decisions in an episode,
    epsilon_max: float = Field(0.15, ge=0, le=1)  # drawn for each
    discount: float = Field(0.9, ge=0, lt=1)  # of the next step, as of the base
    running_weight: float = Field(1.0, ge=0, le=1)  # of running vehicles in the reward, likewise
    reward_scale: float = Field(40.0, gt=0)  # [vehicles] that count as 1, likewise

    also: tuple[Path, ...] = ()  # trainings by lookahead whose episodes are learned from, too
    patterns: tuple[Failure, ...] = ()  # lost in thought, a mask each for every episode;
    fill: str = "universal"  # diffusion weights that fill their holes,
    sampling_steps: int = Field(10, ge=1)  # in so many reverse steps
    complete: float = Field(0.25, ge=0, le=1)  # share of updates with everything observed
    history: int = Field(4, ge=0, le=MOST_HISTORY)  # [decision steps] that the result looks back
    updates: int = Field(10_000, ge=1)
    batch: int = Field(1024, ge=1)  # [intersections] of an update
    learning_rate: float = Field(1e-3, gt=0)  # falls to 0 on a straight line
    weight_decay: float = Field(0.1, ge=0)
    average: float = Field(0.005, gt=0, le=1)  # rate of the moving average that is kept
    seed: int = Field(0, ge=0)

    @property
    def masked(self) -> bool:
        """Whether there is anything that was not seen: then the result is told what."""
        return bool(self.patterns) or set(self.lost) != {"none"}

    @model_validator(mode="after")
    def _means_something(self) -> Self:
        for name in ("volume", "epsilon"):
            if getattr(self, f"{name}_min") > getattr(self, f"{name}_max"):
                raise ValueError(f"{name}_min must not be above {name}_max")
        if not self.lost:
            raise ValueError("lost must name a pattern, or none")
        if self.held_out >= self.episodes:
            raise ValueError("held_out must leave an episode to learn from")
        return self
