"""What a training by Q-learning is: one TOML file."""

from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from tsc_missing.config import Settings
from tsc_missing.qlearning.features import MOST_HISTORY

Algorithm = Literal["advanced-colight", "attendlight", "efficient-colight", "value"]
Reward = Literal["vehicles", "departures"]
"""What a step is worth (``qlearning.rewards``).

``vehicles``: minus the vehicles on the entrance lanes at its end, the running ones with a weight.
``departures``: the vehicles that its greens let through.
"""


class QLearningSettings(Settings):
    """Everything that the weights depend on."""

    algorithm: Algorithm
    nets: tuple[str, ...] = Field(min_length=1)  # names or network folders, taken in turn
    demand: Literal["auto", "profile", "recorded"] = "profile"
    volume_min: float = Field(0.8, gt=0, le=10)  # times the arrivals, where a profile gives them,
    volume_max: float = Field(1.2, gt=0, le=10)  # drawn for each episode
    data: Path | None = None  # an offline dataset to learn from besides
    start: str | None = None  # weights to begin with, a name or a path
    horizon: int = Field(3600, ge=30)  # [s] of an episode: two decisions at least

    width: int = Field(32, ge=4, multiple_of=4)
    history: int = Field(0, ge=0, le=MOST_HISTORY)  # [decision steps] that "value" looks back
    reward: Reward = "vehicles"
    running_weight: float = Field(0.0, ge=0, le=1)  # of running vehicles in the reward "vehicles"
    reward_scale: float = Field(20.0, gt=0)  # [vehicles] that count as 1
    discount: float = Field(0.9, ge=0, lt=1)  # of the next step

    rounds: int = Field(40, ge=1)
    episodes: int = Field(2, ge=1)  # of a round
    epsilon_first: float = Field(0.5, ge=0, le=1)  # share of random decisions in round 0,
    epsilon_last: float = Field(0.02, ge=0, le=1)  # and from the middle of the training on
    before: int = Field(0, ge=0)  # updates on ``data`` before the first round
    updates: int = Field(300, ge=1)  # of a round
    batch: int = Field(512, ge=1)  # intersections in an update, at least
    learning_rate: float = Field(1e-3, gt=0)  # the highest
    final_learning_rate: float = Field(1e-5, ge=0)  # reached on a straight line
    target_rate: float = Field(0.005, gt=0, le=1)  # of the moving average that gives targets
    gradient_norm: float = Field(1.0, gt=0)
    memory: int = Field(60, ge=1)  # the latest episodes of its own that it learns from
    own_share: float = Field(0.5, ge=0, le=1)  # of an update from own episodes, where data is given
    seed: int = Field(0, ge=0)

    @model_validator(mode="after")
    def _means_something(self) -> Self:
        if self.volume_min > self.volume_max:
            raise ValueError("volume_min must not be above volume_max")
        if self.history and self.algorithm != "value":
            raise ValueError(f"history must be 0: {self.algorithm} does not look back")
        if self.before and self.data is None:
            raise ValueError("updates before the first round need data")
        return self

    def epsilon(self, number: int) -> float:
        """The share of random decisions in a round."""
        part = min(1.0, 2 * number / max(self.rounds - 1, 1))
        return self.epsilon_first + part * (self.epsilon_last - self.epsilon_first)

    def rate(self, part: float) -> float:
        """The learning rate when ``part`` (0 … 1) of all updates are done."""
        return self.learning_rate + part * (self.final_learning_rate - self.learning_rate)

    @property
    def all_updates(self) -> int:
        """Of the whole training."""
        return self.before + self.rounds * self.updates
