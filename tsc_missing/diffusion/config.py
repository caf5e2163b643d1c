"""Every setting of the diffusion controller, with its unit and default."""

from typing import Literal, Self

from pydantic import Field, model_validator

from tsc_missing.config import Settings

Precision = Literal["float32", "bfloat16"]

PUBLISHED = {  # the method as its paper has it: whole, and what was added here switched off
    "noise_model": "stformer",
    "padded_rewards": False,
    "dcm": True,
    "inverse_dynamics": True,
    "predict": "noise",
    "known_flag": False,
    "own_signals": False,
    "slot_identity": False,
    "downstream": False,
}


class ScalingSettings(Settings):
    """Fixed scales that bring measurements to the size of the noise."""

    vehicles: float = Field(10.0, gt=0)  # [vehicles] that count as 1
    queue: float = Field(10.0, gt=0)  # [vehicles] that count as 1
    clip: float = Field(8.0, gt=0)  # scaled values end here
    reward: float = Field(
        100.0, gt=0
    )  # [vehicles] queueing at an intersection: reward 0, the worst
    red_steps: float = Field(20.0, gt=0)  # [decision steps] without green that count as 1, the most


class DiffLightConfig(Settings):
    """The diffusion controller, as trained: what a weights file must agree with."""

    history: int = Field(5, ge=1)  # C, observed steps
    horizon: int = Field(3, ge=1)  # H, planned steps
    diffusion_steps: int = Field(100, ge=1)  # K
    guidance: float = Field(1.2, ge=0)  # ω
    target_reward: float = 1.0  # asked for at t+1 … t+H; 1 is the best there is
    reward_dropout: float = Field(0.25, ge=0, le=1)  # p
    predict: Literal["x0", "noise"] = "x0"
    partial_loss: bool = False  # what is hidden is learned as it is generated, without rewards
    scaling: ScalingSettings = ScalingSettings()

    width: int = Field(64, ge=8)  # D
    heads: int = Field(2, ge=1)
    layers: int = Field(1, ge=1)  # L, encoder layers
    hidden: int = Field(128, ge=8)  # of the MLP of an encoder layer
    inverse_width: int = Field(64, ge=8)  # of the inverse dynamics

    known_flag: bool = True  # whether a cell is known is an input
    own_signals: bool = True  # green, and steps since the last green, are inputs
    slot_identity: bool = True  # every slot has an embedding of its own

    noise_model: Literal["stformer", "unet"] = "stformer"
    padded_rewards: bool = False  # ablation: zeros for missing rewards, no PRCD
    dcm: bool = True
    neighbours: bool = True
    downstream: bool = True  # what is on the roads that a slot leads to is an input
    inverse_dynamics: bool = True  # ablation: else observations and actions are diffused together

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.width % self.heads:
            raise ValueError(f"width {self.width} must be a multiple of heads {self.heads}")
        if self.partial_loss and self.padded_rewards:
            raise ValueError("partial_loss needs partial rewards: padded_rewards must be false")
        if self.noise_model == "unet" and (self.steps % 4 or self.width % 8):
            raise ValueError("the U-Net needs history + horizon a multiple of 4, width of 8")
        return self

    @property
    def steps(self) -> int:
        """T = C + H, the steps of a trajectory."""
        return self.history + self.horizon

    @classmethod
    def as_published(cls) -> "DiffLightConfig":
        """The method as its paper has it, without what was added here."""
        return cls.model_validate({**PUBLISHED, "partial_loss": True, "heads": 4})

    @property
    def is_published(self) -> bool:
        """Whether it is the method of the paper, whole and no more; sizes and loss may differ."""
        return all(getattr(self, name) == value for name, value in PUBLISHED.items())
