"""What a controller has at a decision, in vehicles and steps, as inputs of the model."""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as nnf

from tsc_missing.diffusion.batch import Inputs, gather_downstream, gather_neighbours
from tsc_missing.diffusion.config import DiffLightConfig
from tsc_missing.diffusion.scaling import Scaling
from tsc_missing.sensing.observation import QUEUE


@dataclass(frozen=True)
class History:
    """The last C decision steps of all N intersections of a network, the present one last.

    Steps before the first are not known. Values may be anything, NaN too, where not known.
    """

    values: Tensor  # (N, C, L, F) vehicles, queue [vehicles]
    known: Tensor  # (N, C, L) bool
    green: Tensor  # (N, C, L) bool: green in the step that ends here
    red_steps: Tensor  # (N, C, L) decision steps since the last green
    observable: Tensor  # (N, L) bool: m_obs of the future, sensors are expected to report
    slots: Tensor  # (N, L) bool
    neighbours: Tensor  # (N, L, 3) flat upstream slots, -1 for none
    downstream: Tensor  # (N, L, D) flat slots on the road that a slot leads to, -1 for none
    phases: Tensor  # (N, P, L) bool
    phase_mask: Tensor  # (N, P) bool


@dataclass(frozen=True)
class Plan:
    """What the model makes of a history, in vehicles."""

    imputed: Tensor  # (N, C, L, F) the history without holes
    future: Tensor  # (N, H, L, F) planned
    logits: Tensor  # (N, P) of the phase to run now, -inf without the phase


def rewards(
    vehicles: Tensor, seen: Tensor, slots: Tensor, scaling: Scaling
) -> tuple[Tensor, Tensor]:
    """Scaled rewards (B, T) and where they are known: where all slots are ``seen`` (B, T, L).

    ``vehicles`` (B, T, L, F) [vehicles] may be NaN where not seen; ``slots`` (B, L).
    """
    counted = seen & slots.unsqueeze(1)
    queue = torch.where(counted, vehicles[..., QUEUE], 0.0).sum(dim=2)
    return scaling.reward(-queue), (seen | ~slots.unsqueeze(1)).all(dim=2)


def inputs_at_inference(
    history: History, table: Tensor, config: DiffLightConfig, scaling: Scaling
) -> tuple[Inputs, Tensor]:
    """Inputs over the T steps, and the known values (N, T, L, F) scaled, 0 where not known.

    ``table`` (N, G, 3) is the grouped neighbour table. The rewards asked for at t+1 … t+H are
    the target, wherever the intersection has a slot that will be observable.
    """
    ahead = config.horizon
    known = history.known & history.slots.unsqueeze(1)
    vehicles = torch.where(known.unsqueeze(-1), history.values.float(), 0.0)
    reward, reward_known = rewards(vehicles, history.known, history.slots, scaling)
    observable = history.observable & history.slots
    sensed = observable.any(dim=1, keepdim=True)
    signals = scaling.signals(history.green, history.red_steps, config.steps)
    all_known = nnf.pad(known, (0, 0, 0, ahead))
    values = nnf.pad(scaling.values(vehicles), (0, 0, 0, 0, 0, ahead))
    inputs = Inputs(
        known=all_known,
        slots=history.slots,
        reward=nnf.pad(reward, (0, ahead), value=config.target_reward),
        reward_known=torch.cat((reward_known, sensed.expand(-1, ahead)), dim=1),
        observable=torch.cat((known, observable.unsqueeze(1).expand(-1, ahead, -1)), dim=1),
        signals=signals,
        neighbours=gather_neighbours(values, all_known, signals, table),
        downstream=gather_downstream(values, all_known, history.downstream),
    )
    return inputs, values
