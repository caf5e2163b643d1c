"""What a controller is, and what it may know."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from tsc_missing.network.model import BoolArray, FloatArray, IntArray, Network
from tsc_missing.sensing.observation import Observation


@dataclass(frozen=True)
class ControlContext:
    """What is known before the first step.

    ``turning_flows`` are the vehicles per hour that want to use each slot, as from a turning
    count, or where nobody ``counted`` the same for each lane; ``sensors`` is the inventory: which
    slots have a sensor that may report. A phase that ends before ``min_steps`` is held, so that
    another one is late or, in a cycle, left out.
    """

    network: Network
    turning_flows: FloatArray  # (N, 12) [vehicles/h]
    sensors: BoolArray  # (N, 12)
    decision_interval: float  # [s]
    lost_time: float  # [s] yellow and all-red at a change of phase
    min_steps: IntArray  # (N,) [decision steps] of a phase, its lost time and minimum green
    seed: int
    spacing: float = 7.5  # [m] of a lane that a standing vehicle takes, its gap included
    tau: float = 2.0  # [s] of the vehicles, from the bumper before to their own
    max_speed: float = 11.111  # [m/s] of the vehicles, where the road allows it
    detector_length: float | None = None  # [m] before the stop line; None: whole lanes
    counted: bool = True


class Controller(ABC):
    """Chooses a phase for every intersection at every decision step, from observations only.

    Of a class that can be had by name, ``needs_values`` says that it is composed with an imputer
    and so gets finite numbers everywhere; else it gets NaN where nothing reported.
    """

    needs_values: ClassVar[bool] = True

    @abstractmethod
    def reset(self, context: ControlContext) -> None:
        """Forget everything and get ready for a run on the context's network."""

    @abstractmethod
    def decide(self, observation: Observation) -> IntArray:
        """(N,): the phase of each intersection for the coming step."""

    def estimates(self) -> FloatArray | None:
        """(N, 12, F): the values that the last decision was based on, if it filled holes."""
        return None

    def plans(self) -> FloatArray | None:
        """(N, H, 12, F): what was generated of the next H steps, if that was."""
        return None
