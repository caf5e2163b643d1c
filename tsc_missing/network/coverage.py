"""How much of its readings each movement slot of a network loses under a mask."""

from dataclasses import dataclass
from functools import cached_property

from tsc_missing.network.model import BoolArray, FloatArray


@dataclass(frozen=True)
class Coverage:
    """The share of missing readings of every slot over the steps of a mask."""

    missing: FloatArray  # (N, 12), 0 to 1; 0 where the slot is absent
    present: BoolArray  # (N, 12): whether the slot is there

    @classmethod
    def of_mask(cls, mask: BoolArray, present: BoolArray) -> "Coverage":
        """From a mask (T, N, 12), true = reported, of at least one step."""
        return cls((~mask).mean(axis=0) * present, present)

    @cached_property
    def intersections(self) -> FloatArray:
        """(N,): the share of missing readings of each intersection."""
        share: FloatArray = self.missing.sum(axis=1) / self.present.sum(axis=1).clip(min=1)
        return share

    @cached_property
    def never(self) -> BoolArray:
        """(N, 12): slots that never report."""
        return self.present & (self.missing >= 1)

    @cached_property
    def blind(self) -> BoolArray:
        """(N,): intersections that are never observed."""
        blind: BoolArray = self.present.any(axis=1) & (self.never == self.present).all(axis=1)
        return blind

    @cached_property
    def partly(self) -> BoolArray:
        """(N,): intersections that are observed, but not always and everywhere."""
        partly: BoolArray = (self.missing > 0).any(axis=1) & ~self.blind
        return partly

    @cached_property
    def uneven(self) -> BoolArray:
        """(N,): intersections whose slots differ in their share of missing readings."""
        lowest = self.missing.min(axis=1, where=self.present, initial=1.0)
        highest = self.missing.max(axis=1, where=self.present, initial=0.0)
        uneven: BoolArray = highest > lowest
        return uneven

    @property
    def share(self) -> float:
        """The share of all readings that is missing."""
        return float(self.missing.sum() / max(1, self.present.sum()))
