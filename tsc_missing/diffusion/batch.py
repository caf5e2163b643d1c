"""What the model is given: windows of trajectories, masks and neighbours."""

from dataclasses import dataclass

import torch
from torch import Tensor

from tsc_missing.network.slots import APPROACHES, MAX_NEIGHBOURS, N_SLOTS

N_SIGNALS = 2  # own-signal features: green, steps since the last green


@dataclass(frozen=True)
class Neighbours:
    """Trajectories of the slots upstream, by group of slots that share them.

    G groups of 12 / G consecutive slots: the four approaches where the slots of each are fed by
    the same neighbours (``group_table``), else twelve groups of one.
    """

    values: Tensor  # (B, G, 3, T, F) scaled; anything where not given
    given: Tensor  # (B, G, 3, T) bool: recorded, or generated where DCM gives it
    signals: Tensor  # (B, G, 3, T, 2)
    exists: Tensor  # (B, G, 3) bool


@dataclass(frozen=True)
class Inputs:
    """All that the noise model sees beside x^k: y'(τ), r(τ) and the masks.

    ``reward[:, t]`` is minus the queue that the observation of the same step shows.
    """

    known: Tensor  # (B, T, L) bool: observed and not hidden; never after now
    slots: Tensor  # (B, L) bool: whether the slot is there
    reward: Tensor  # (B, T) scaled; anything where not known
    reward_known: Tensor  # (B, T) bool
    observable: Tensor  # (B, T, L) bool: m_obs, sensors report or will report here
    signals: Tensor  # (B, T, L, 2) own signals, 0 after now
    neighbours: Neighbours


@dataclass(frozen=True)
class TrainingBatch:
    """Windows with the truth where the loss may use it."""

    inputs: Inputs
    values: Tensor  # (B, T, L, F) scaled; anything where neither known nor target
    target: Tensor  # (B, T, L) bool: cells hidden on purpose, and the observable future
    green: Tensor  # (B, T, L) bool: green in the step that ends at t, after now too
    phases: Tensor  # (B, P, L) bool: the slots that a phase serves
    phase_mask: Tensor  # (B, P) bool
    action: Tensor  # (B,) int: the phase that ran from now (step C - 1) to the next step
    action_known: Tensor  # (B,) bool: both ends of that transition are recorded


def group_table(neighbours: Tensor, slots: Tensor) -> Tensor:
    """A neighbour table (N, 12, 3) of flat slots, -1 for none, as (N, G, 3): once an approach.

    G is 4 where in every approach all slots that are there have the same neighbours, else 12.
    """
    turns = N_SLOTS // len(APPROACHES)
    table = neighbours.view(-1, len(APPROACHES), turns, MAX_NEIGHBOURS)
    there = slots.view(-1, len(APPROACHES), turns)
    first = there.int().argmax(dim=2)
    chosen = table.gather(2, first[:, :, None, None].expand(-1, -1, 1, MAX_NEIGHBOURS))
    same = (table == chosen).all(dim=3) | ~there
    return chosen.squeeze(2) if bool(same.all()) else neighbours


def gather_neighbours(values: Tensor, given: Tensor, signals: Tensor, table: Tensor) -> Neighbours:
    """The neighbours of N intersections from the trajectories of all.

    ``values`` (N, T, L, F), ``given`` (N, T, L), ``signals`` (N, T, L, 2), ``table`` (N, G, 3) of
    flat slots into the same N, -1 for none. Several networks can be one batch: add to the table
    of each the flat slots that come before it.
    """
    exists = table >= 0

    def pick(x: Tensor) -> Tensor:
        flat = x.transpose(1, 2).flatten(0, 1)  # (N * L, T, …)
        return flat[table.clamp(min=0)]

    return Neighbours(
        values=pick(values),
        given=pick(given) & exists.unsqueeze(-1),
        signals=pick(signals),
        exists=exists,
    )


def blank(x: Tensor, mask: Tensor) -> Tensor:
    """``x`` (…, F) with zeros, even for NaN, where ``mask`` (…) is false."""
    return torch.where(mask.unsqueeze(-1), x, 0.0)
