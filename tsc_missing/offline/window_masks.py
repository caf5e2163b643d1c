"""Masks drawn for single windows: what is hidden of a window and of its neighbours.

Every random number is a hash of the window's key and the cell (intersection, slot, step), so a
window's mask covers the whole network without being drawn for more than the cells that are
looked at, and a cell that is looked at twice is the same.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from tsc_missing.config import Settings
from tsc_missing.network.model import BoolArray, FloatArray, IntArray
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.sensing.outages import largest_share, outages

UIntArray = npt.NDArray[np.uint64]

# Purposes that random numbers of a cell are kept apart by.
BLIND, STEP, BURST, LANE = range(4)


class MaskMix(Settings):
    """The shares of windows that each pattern hides from; used relative to their sum.

    none: nothing. random: each step of an intersection. blind: the whole trajectory of the
    window's intersection (kriging). near: whole trajectories of neighbours, the window's own
    intersection is seen (kriging, from next to it). lane: each step of a slot. burst: outages of
    intersections. mixed: blind, burst and lane at once. Rates are drawn for each window.
    """

    none: float = Field(0.15, ge=0)
    random: float = Field(0.3, ge=0)
    blind: float = Field(0.25, ge=0)
    near: float = Field(0.1, ge=0)
    lane: float = Field(0.1, ge=0)
    burst: float = Field(0.05, ge=0)
    mixed: float = Field(0.05, ge=0)

    rate_min: float = Field(0.05, ge=0, le=1)  # of random, lane and burst, uniform
    rate_max: float = Field(0.9, ge=0, le=1)
    blind_near: float = Field(0.1, ge=0, le=1)  # of the neighbours of a blind intersection
    near_blind: float = Field(0.3, ge=0, le=1)  # of the neighbours in near and mixed
    mean_outage: float = Field(8.0, ge=1)  # [decision steps]

    @model_validator(mode="after")
    def _means_something(self) -> Self:
        if sum(self.shares) <= 0:
            raise ValueError("the shares of the patterns must not all be 0")
        if self.rate_min > self.rate_max:
            raise ValueError("rate_min must not be above rate_max")
        return self

    @property
    def shares(self) -> tuple[float, ...]:
        """The seven shares in the order of ``PATTERNS``."""
        return (
            self.none,
            self.random,
            self.blind,
            self.near,
            self.lane,
            self.burst,
            self.mixed,
        )


PATTERNS = ("none", "random", "blind", "near", "lane", "burst", "mixed")


@dataclass(frozen=True)
class WindowMasks:
    """The masks of B windows, as their parameters."""

    key: UIntArray  # (B,)
    own: IntArray  # (B,) the window's intersection
    own_blind: BoolArray  # (B,)
    near_blind: FloatArray  # (B,) probability that another intersection is blind
    step_rate: FloatArray  # (B,) of an intersection at a step
    lane_rate: FloatArray  # (B,) of a slot, or of those that share sensors, at a step
    burst_rate: FloatArray  # (B,) share of time in an outage
    mean_outage: float  # [decision steps]

    def seen(self, intersections: IntArray, slots: IntArray, steps: int) -> BoolArray:
        """(B, …, T): whether cells report; ``intersections`` and ``slots`` (B, …).

        Slots that share sensors report together: say ``Network.slots_in_common`` of each.
        """
        shape = (-1, *[1] * (intersections.ndim - 1))

        def each(x: FloatArray) -> FloatArray:
            return x.reshape(*shape, 1)

        key = self.key.reshape(shape)
        time = np.arange(steps)
        whole = np.full(intersections.shape, N_SLOTS)
        other = uniform(key, intersections, whole, BLIND) < self.near_blind.reshape(shape)
        mine = intersections == self.own.reshape(shape)
        blind = np.where(mine, self.own_blind.reshape(shape), other)
        key = key[..., None]
        intersections, whole, slots = (x[..., None] for x in (intersections, whole, slots))
        seen = np.broadcast_to(~blind[..., None], (*blind.shape, steps)).copy()
        if self.step_rate.any():
            seen &= uniform(key, intersections, whole, STEP, time) >= each(self.step_rate)
        if self.lane_rate.any():
            seen &= uniform(key, intersections, slots, LANE, time) >= each(self.lane_rate)
        if self.burst_rate.any():
            chance = uniform(key, intersections, whole, BURST, time)
            share = self.burst_rate.reshape(shape)
            out = outages(share, self.mean_outage, np.moveaxis(chance, -1, 0))
            seen &= ~np.moveaxis(out, 0, -1)
        return seen


def draw_masks(mix: MaskMix, own: IntArray, rng: np.random.Generator) -> WindowMasks:
    """Masks for windows of the intersections ``own`` (B,)."""
    count = len(own)
    shares = np.array(mix.shares)
    edges = np.cumsum(shares / shares.sum())[:-1]
    pattern = np.searchsorted(edges, rng.random(count), side="right")
    rate = rng.uniform(mix.rate_min, mix.rate_max, count)
    most = largest_share(mix.mean_outage)  # an outage ends in the end

    def of(*names: str) -> BoolArray:
        return np.isin(pattern, [PATTERNS.index(name) for name in names])

    mixed = of("mixed")
    part = np.where(mixed, rate / 3, rate)
    near = np.where(of("near", "mixed"), mix.near_blind, 0.0)
    return WindowMasks(
        key=rng.integers(2**64, size=count, dtype=np.uint64),
        own=own,
        own_blind=of("blind") | (mixed & (rng.random(count) < mix.near_blind)),
        near_blind=np.where(of("blind"), mix.blind_near, near),
        step_rate=np.where(of("random"), rate, 0.0),
        lane_rate=np.where(of("lane", "mixed"), part, 0.0),
        burst_rate=np.where(of("burst", "mixed"), np.minimum(part, most), 0.0),
        mean_outage=mix.mean_outage,
    )


def uniform(
    key: UIntArray, intersection: IntArray, slot: IntArray, purpose: int, step: IntArray | int = 0
) -> FloatArray:
    """Numbers in [0, 1) that depend on nothing but the arguments (which broadcast).

    The output function of SplitMix64 (Steele, Lea and Flood, 2014), at the position of the cell
    in the stream that starts at ``key``.
    """
    cell = ((intersection * (N_SLOTS + 1) + slot) * 4 + purpose) * 1024 + step + 1
    z = key + cell.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(((z ^ (z >> np.uint64(31))) >> np.uint64(11)) * 2.0**-53)
