"""What all trainings of many steps are told. No torch here: commands read this."""

from pydantic import Field

from tsc_missing.config import Settings


class StepSettings(Settings):
    """Steps, the learning rate over them, and how often a training is saved."""

    steps: int = Field(20_000, ge=1)
    batch: int = Field(512, ge=1)  # samples of a step
    learning_rate: float = Field(1e-3, gt=0)  # the highest
    final_learning_rate: float = Field(1e-5, ge=0)  # reached on a half cosine
    warm_up: int = Field(200, ge=0)  # steps of rising learning rate
    gradient_norm: float = Field(1.0, gt=0)  # gradients longer than this are cut to it
    seed: int = Field(0, ge=0)

    log_steps: int = Field(50, ge=1)  # steps that a row of metrics.csv is the mean of
    checkpoint_seconds: float = Field(60.0, ge=0, le=60)
