"""What to collect: the settings of a collection, and the episodes that follow from its seed."""

from typing import Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from tsc_missing.config import SEEDS, MissingSettings, RunSettings, Settings
from tsc_missing.controllers.base import Controller
from tsc_missing.errors import UserError, nearest
from tsc_missing.offline.policies import POLICIES, RULES
from tsc_missing.own_code import is_own, own_class
from tsc_missing.seeding import stream
from tsc_missing.sensing.failures import MaybeFailure

POLICY = "policy"


class CollectSettings(Settings):
    """An offline dataset before it is there."""

    nets: tuple[str, ...] = Field(min_length=1)  # names or network folders, taken in turn
    demand: Literal["auto", "profile", "recorded"] = "profile"
    volume_min: float = Field(0.6, gt=0, le=10)  # times the profile's arrivals,
    volume_max: float = Field(1.4, gt=0, le=10)  # drawn for each episode
    policies: tuple[str, ...] = Field(RULES, min_length=1)
    epsilon_min: float = Field(0.0, ge=0, le=1)  # share of random decisions,
    epsilon_max: float = Field(0.2, ge=0, le=1)  # drawn for each episode
    switch: float = Field(0.25, ge=0, le=1)  # share of episodes with two policies in turn
    unaware: float = Field(0.6, ge=0, le=1)  # most of the intersections that see nothing
    neglect: float = Field(0.0, ge=0, le=1)  # share of these that neglect some phases
    lost: tuple[MaybeFailure, ...] = ("none",)  # what the policies do not see, in turn
    min_space: int = Field(0, ge=0)  # [vehicles a lane] that policies keep on short roads; 0: none
    missing: MissingSettings = MissingSettings()  # holes of the log
    horizon: int = Field(3600, ge=30)  # [s] of an episode: two decisions at least
    episodes: int = Field(60, ge=1)
    code: dict[str, str] = Field(default_factory=dict)  # SHA-256 of users' own policies' files
    seed: int = Field(0, ge=0, lt=SEEDS)

    @field_validator("missing")
    @classmethod
    def _leaves_something(cls, missing: MissingSettings) -> MissingSettings:
        if missing.pattern not in ("none", "file") and not 0 < missing.rate < 1:
            raise ValueError("the rate of holes must be above 0 and below 1")
        return missing

    @model_validator(mode="after")
    def _ranges(self) -> Self:
        if self.volume_min > self.volume_max:
            raise ValueError(f"volume_min must not be above volume_max, {self.volume_max:g}")
        if self.epsilon_min > self.epsilon_max:
            raise ValueError(f"epsilon_min must not be above epsilon_max, {self.epsilon_max:g}")
        if self.missing.file:
            raise ValueError("the holes of a log are drawn, not read from a file")
        if not self.lost:
            raise ValueError("lost must name a pattern, or none")
        return self

    def check(self) -> None:
        """Raise ``UserError`` for a policy that is unknown."""
        for name in self.policies:
            if is_own(name):
                own_class(name, POLICY, Controller)
            elif name not in POLICIES:
                raise UserError(POLICY, name, nearest(name, POLICIES))


class EpisodeSpec(Settings):
    """One episode: it depends on the collection's seed and its own number only."""

    number: int
    net: str
    demand: Literal["auto", "profile", "recorded"]
    volume: float
    policies: tuple[str, ...]  # in turn
    switch_at: int | None  # [decision steps] where the second policy takes over
    epsilon: float
    unaware: float  # share of the intersections whose policy sees nothing
    neglect: float = 0.0  # share of these that neglect some phases
    lost: MaybeFailure = "none"  # what the policies do not see
    min_space: int = 0  # [vehicles a lane] that the policies keep on short roads
    missing: MissingSettings
    mask_seed: int
    horizon: int  # [s]
    seed: int

    @property
    def file(self) -> str:
        """The name of its file."""
        return f"{self.number:05d}.parquet"

    def run_settings(self) -> RunSettings:
        """The settings of the run, but for what is collected only."""
        return RunSettings(
            net=self.net,
            demand=self.demand,
            volume=self.volume,
            horizon=self.horizon,
            seed=self.seed,
        )


def draw_spec(settings: CollectSettings, number: int, scaled: bool = True) -> EpisodeSpec:
    """Episode ``number`` of a collection; ``scaled``: the demand of its network can be scaled.

    What never reports, in kriging masks and lasting ones, is the same in every episode, and in runs
    with the collection's seed as mask seed. All else is drawn anew for each episode; other masks
    have seeds that no run can have.
    """
    rng = stream(settings.seed, f"episode-{number}")
    drawn = _uniform(rng, settings.volume_min, settings.volume_max)
    epsilon = _uniform(rng, settings.epsilon_min, settings.epsilon_max)
    chosen = rng.permutation(len(settings.policies))[: 1 + int(rng.random() < settings.switch)]
    unaware = _uniform(rng, 0.0, settings.unaware)
    steps = RunSettings(horizon=settings.horizon).steps
    seed, mask_seed = (int(rng.integers(2**31)) for _ in range(2))
    if settings.missing.pattern == "kriging" or settings.missing.lasting:
        mask_seed = settings.seed
    elif settings.missing.pattern != "none":
        mask_seed += SEEDS
    return EpisodeSpec(
        number=number,
        net=settings.nets[number % len(settings.nets)],
        demand=settings.demand,
        volume=drawn if scaled else 1.0,
        policies=tuple(settings.policies[k] for k in chosen),
        switch_at=int(steps * rng.uniform(0.25, 0.75)) if len(chosen) > 1 else None,
        epsilon=epsilon,
        unaware=unaware,
        neglect=settings.neglect,
        lost=settings.lost[number // len(settings.nets) % len(settings.lost)],
        min_space=settings.min_space,
        missing=settings.missing,
        mask_seed=mask_seed,
        horizon=settings.horizon,
        seed=seed,
    )


def _uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return round(float(rng.uniform(low, high)), 4)
