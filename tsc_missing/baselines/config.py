"""What the training of a baseline is: one TOML file. No torch here: commands read this."""

from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, model_validator

from tsc_missing.training.step_settings import StepSettings


class BaselineSettings(StepSettings):
    """What all baselines have; each algorithm adds its own options."""

    algorithm: str
    data: Path  # the dataset's folder
    held_out: float = Field(0.1, gt=0, lt=1)  # share of the episodes that nothing is learned from

    width: int = Field(32, ge=4, multiple_of=4)
    running_weight: float = Field(0.0, ge=0, le=1)  # of running vehicles in the reward
    reward_scale: float = Field(20.0, gt=0)  # [vehicles] that count as 1

    steps: int = Field(8000, ge=1)  # updates
    batch: int = Field(512, ge=1)  # samples of an update, at least; one is of one intersection
    warm_up: int = Field(100, ge=0)  # updates of rising learning rate
    log_steps: int = Field(500, ge=1)  # updates between rows of metrics.csv


class BCSettings(BaselineSettings):
    """Behaviour cloning."""

    algorithm: Literal["bc"]


class CQLSettings(BaselineSettings):
    """Conservative Q-learning."""

    algorithm: Literal["cql"]
    alpha: float = Field(0.1, ge=0)  # of the conservative term
    discount: float = Field(0.8, ge=0, lt=1)  # of the next step
    target_rate: float = Field(0.005, gt=0, le=1)  # of the moving average that gives targets


class TD3BCSettings(BaselineSettings):
    """TD3+BC for phases."""

    algorithm: Literal["td3-bc"]
    alpha: float = Field(2.5, ge=0)  # of the values, against cloning
    smoothing: float = Field(0.1, ge=0, le=1)  # share of uniform phases in the target policy
    policy_delay: int = Field(2, ge=1)  # updates of the critics for one of the actor
    discount: float = Field(0.8, ge=0, lt=1)  # of the next step
    target_rate: float = Field(0.005, gt=0, le=1)  # of the moving averages


class CQLModelBasedSettings(CQLSettings):
    """Conservative Q-learning on logs with holes."""

    algorithm: Literal["cql-model-based"]  # type: ignore[assignment]
    reward_steps: int = Field(2000, ge=1)  # updates of the reward model, before those of the values

    @model_validator(mode="after")
    def _learns_values(self) -> Self:
        if self.reward_steps >= self.steps:
            raise ValueError(f"steps must be more than the {self.reward_steps} of reward_steps")
        return self


class DecisionTransformerSettings(BaselineSettings):
    """Decision Transformer."""

    algorithm: Literal["decision-transformer"]
    history: int = Field(8, ge=1)  # K, steps that it looks at
    layers: int = Field(2, ge=1)
    heads: int = Field(2, ge=1)
    asked_quantile: float = Field(0.9, ge=0, le=1)  # of the logs' returns: what a run asks for

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.width % self.heads:
            raise ValueError(f"width {self.width} must be a multiple of heads {self.heads}")
        return self


class PlannerSettings(BaselineSettings):
    """What the two planners by diffusion have."""

    width: int = Field(32, ge=8, multiple_of=8)
    history: int = Field(5, ge=1)  # C, steps that are known
    horizon: int = Field(3, ge=1)  # H, steps that are planned
    diffusion_steps: int = Field(100, ge=1)  # K
    sampling_steps: int = Field(10, ge=1)  # of a decision
    temperature: float = Field(0.5, ge=0)  # of the noise that a plan begins as
    discount: float = Field(0.9, ge=0, lt=1)  # of the next step
    average_rate: float = Field(0.005, gt=0, le=1)  # of the moving average that decides

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if (self.history + self.horizon) % 4:
            raise ValueError("history + horizon must be a multiple of 4")
        if self.sampling_steps > self.diffusion_steps:
            raise ValueError("sampling_steps must be at most diffusion_steps")
        return self


class DiffuserSettings(PlannerSettings):
    """Diffuser."""

    algorithm: Literal["diffuser"]
    guidance: float = Field(1.0, ge=0)  # times the gradient of the return


class DecisionDiffuserSettings(PlannerSettings):
    """Decision Diffuser."""

    algorithm: Literal["decision-diffuser"]
    guidance: float = Field(1.2, ge=0)  # ω
    return_dropout: float = Field(0.25, ge=0, le=1)  # p
    asked_quantile: float = Field(0.9, ge=0, le=1)  # of the logs' returns: what a run asks for


SETTINGS: dict[str, type[BaselineSettings]] = {
    "bc": BCSettings,
    "cql": CQLSettings,
    "cql-model-based": CQLModelBasedSettings,
    "decision-diffuser": DecisionDiffuserSettings,
    "decision-transformer": DecisionTransformerSettings,
    "diffuser": DiffuserSettings,
    "td3-bc": TD3BCSettings,
}
"""The baselines by name, which is the controller's and the bundled config's too."""


def settings_class(algorithm: Any) -> type[BaselineSettings] | None:
    """The settings of a baseline, None for the name of something else."""
    return SETTINGS.get(algorithm) if isinstance(algorithm, str) else None


def train_command(controller: str, net: str) -> str:
    """What makes the weights of a baseline for a dataset's network, in ``trained_folder``."""
    return f"tsc-train {controller} --data data/{_log(controller, net)}"


def trained_folder(controller: str, net: str) -> str:
    """Where the ``train_command`` leaves them."""
    return f"runs/train-{controller}-{_log(controller, net)}"


def _log(controller: str, net: str) -> str:
    with_holes = SETTINGS[controller] is CQLModelBasedSettings
    return f"strict-{net}-random" if with_holes else net
