"""What sensors report: values with holes. Everything under a hole is NaN."""

from dataclasses import dataclass, replace

import numpy as np

from tsc_missing.network.model import BoolArray, FloatArray, IntArray

VEHICLES, QUEUE = range(2)  # the features F: vehicles on the lanes; those slower than 0.1 m/s
N_FEATURES = 2


def reward_of(values: FloatArray) -> FloatArray:
    """(N,): minus the vehicles queueing on the entrance lanes, from values (N, 12, F)."""
    return np.asarray(-values[:, :, QUEUE].sum(axis=1))


@dataclass(frozen=True)
class Measurement:
    """The truth at a decision time, over N intersections; never handed to a controller.

    Slots that the intersection does not have hold zeros.
    """

    values: FloatArray  # (N, 12, F) vehicles, queue
    exits: FloatArray  # (N, 12) vehicles on those of a movement's exit lanes that end at no signal

    @property
    def reward(self) -> FloatArray:
        """(N,): see ``reward_of``."""
        return reward_of(self.values)


@dataclass(frozen=True)
class Observation:
    """A measurement as far as its sensors reported, and what is known without sensors.

    ``mask`` is true where a slot reported; slots that are not there count as reported, with
    zeros. ``values``, ``exits`` and ``reward`` are NaN where nothing was reported. The signals'
    own state is always known: ``phase`` is what ran last (-1 before the first decision), and
    ``red_steps`` counts the decision steps since a slot last had green (0: it has it now).
    """

    step: int
    time: float  # [s]
    values: FloatArray  # (N, 12, F)
    exits: FloatArray  # (N, 12)
    mask: BoolArray  # (N, 12)
    reward: FloatArray  # (N,)
    phase: IntArray  # (N,)
    red_steps: IntArray  # (N, 12)

    def copy(self) -> "Observation":
        """The same with arrays of its own, for whoever may write into them."""
        return replace(
            self,
            values=self.values.copy(),
            exits=self.exits.copy(),
            mask=self.mask.copy(),
            reward=self.reward.copy(),
            phase=self.phase.copy(),
            red_steps=self.red_steps.copy(),
        )

    def filled(self, values: FloatArray, exits: FloatArray) -> "Observation":
        """The same observation with other values; the mask still tells what was reported."""
        return replace(self, values=values, exits=exits, reward=reward_of(values))


def apply_mask(
    truth: Measurement,
    mask: BoolArray,
    step: int,
    time: float,
    phase: IntArray,
    red_steps: IntArray,
) -> Observation:
    """The observation that sensors with this mask (N, 12) make of the truth.

    The reward of an intersection is known only where all its slots reported.
    """
    return Observation(
        step=step,
        time=time,
        values=np.where(mask[:, :, None], truth.values, np.nan),
        exits=np.where(mask, truth.exits, np.nan),
        mask=mask,
        reward=np.where(mask.all(axis=1), truth.reward, np.nan),
        phase=phase,
        red_steps=red_steps,
    )
