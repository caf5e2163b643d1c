"""Recorded windows, in vehicles and steps, as training batches."""

from dataclasses import dataclass

import torch
from torch import Tensor

from tsc_missing.diffusion.batch import Inputs, Neighbours, TrainingBatch, sum_downstream
from tsc_missing.diffusion.config import DiffLightConfig
from tsc_missing.diffusion.history import rewards
from tsc_missing.diffusion.scaling import Scaling


@dataclass(frozen=True)
class Windows:
    """T decision steps of B intersections of any networks; step C - 1 is now.

    Values may be anything, NaN too, where not recorded (and for neighbours where not given).
    """

    values: Tensor  # (B, T, L, F) vehicles, queue [vehicles]
    recorded: Tensor  # (B, T, L) bool: the log has it
    hidden: Tensor  # (B, T, L) bool: hidden on purpose; counts up to now
    observable: Tensor  # (B, L) bool: m_obs of the future
    green: Tensor  # (B, T, L) bool: green in the step that ends here
    red_steps: Tensor  # (B, T, L) decision steps since the last green
    slots: Tensor  # (B, L) bool
    phases: Tensor  # (B, P, L) bool
    phase_mask: Tensor  # (B, P) bool
    action: Tensor  # (B,) int: the phase that ran from now to the next step
    near_values: Tensor  # (B, G, 3, T, F) of the neighbours, in vehicles
    near_given: Tensor  # (B, G, 3, T) bool: what they tell; also after now, for what DCM gives
    near_green: Tensor  # (B, G, 3, T) bool
    near_red_steps: Tensor  # (B, G, 3, T)
    near_exists: Tensor  # (B, G, 3) bool
    down_values: Tensor  # (B, L, D, T, F) on the roads downstream, in vehicles
    down_given: Tensor  # (B, L, D, T) bool: what they tell
    down_exists: Tensor  # (B, L, D) bool


def training_batch(windows: Windows, config: DiffLightConfig) -> TrainingBatch:
    """Scaled inputs and targets: what is hidden up to now, and the recorded future."""
    scaling = Scaling(config.scaling)
    past = (torch.arange(config.steps) < config.history).unsqueeze(1)  # (T, 1)
    there = windows.slots.unsqueeze(1)
    recorded = windows.recorded & there
    known = recorded & ~windows.hidden & past
    target = recorded & (windows.hidden | ~past)
    reward, reward_known = rewards(
        windows.values, known | (recorded & ~past), windows.slots, scaling
    )
    whole = (recorded | ~there).all(dim=2)
    inputs = Inputs(
        known=known,
        slots=windows.slots,
        reward=reward,
        reward_known=reward_known,
        observable=torch.where(past, recorded, windows.observable.unsqueeze(1)),
        signals=_signals(windows.green, windows.red_steps, config, scaling),
        neighbours=_neighbours(windows, config, scaling),
        downstream=sum_downstream(
            scaling.values(windows.down_values), windows.down_given, windows.down_exists
        ),
    )
    return TrainingBatch(
        inputs=inputs,
        values=scaling.values(windows.values),
        target=target,
        green=windows.green,
        phases=windows.phases,
        phase_mask=windows.phase_mask,
        action=windows.action,
        action_known=whole[:, config.history - 1] & whole[:, config.history],
    )


def _signals(green: Tensor, red: Tensor, config: DiffLightConfig, scaling: Scaling) -> Tensor:
    """(B, T, S) of S slots to (B, T, S, 2), without what comes after now."""
    now = config.history
    return scaling.signals(green[:, :now], red[:, :now], config.steps)


def _neighbours(windows: Windows, config: DiffLightConfig, scaling: Scaling) -> Neighbours:
    by_step = (windows.near_green, windows.near_red_steps)
    green, red = (x.flatten(1, 2).transpose(1, 2) for x in by_step)  # (B, T, G * 3)
    signals = _signals(green, red, config, scaling).transpose(1, 2)
    return Neighbours(
        values=scaling.values(windows.near_values),
        given=windows.near_given & windows.near_exists.unsqueeze(-1),
        signals=signals.reshape(*windows.near_given.shape, -1),
        exists=windows.near_exists,
    )
