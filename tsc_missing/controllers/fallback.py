"""Legal phases whatever a controller answers."""

import time
import traceback
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.controllers.fixed_time import FixedTime
from tsc_missing.controllers.max_queue import MaxQueue
from tsc_missing.controllers.max_red import bounded
from tsc_missing.network.model import FloatArray, IntArray, Network
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.sensing.observation import N_FEATURES, Observation

ERRORS_KEPT = 3


class Safe(Controller):
    """A controller whose every answer is a legal phase.

    The inner controller's answer is used where it is one: at intersections for which it is NaN,
    a fraction or a phase that is not there, the fallback answers. If the inner controller
    raises, answers in another shape or type, or answers later than the deadline, the fallback
    answers the whole step. It cannot stop a controller that never answers. Errors in ``reset``
    are not caught: nothing runs yet.
    """

    def __init__(
        self,
        controller: Controller,
        deadline_s: float,
        clock: Callable[[], float] = time.perf_counter,
        max_red: float = 0,
    ) -> None:
        """``deadline_s`` [s] of wall time for a decision, measured by ``clock``.

        The fallback's reds are bounded by ``max_red`` [s] if it is not 0.
        """
        self.controller = controller
        self.fallback_steps = 0  # intersection-steps that the fallback answered
        self._deadline = deadline_s
        self._clock = clock
        self._fallback = Fallback(max_red)
        self._errors: list[str] = []
        self._used = False

    @property
    def last_error(self) -> str:
        """The first few distinct errors, one after the other; empty if there was none."""
        return "; ".join(self._errors)

    def reset(self, context: ControlContext) -> None:
        """Reset the controller, the fallback and the counts."""
        self.fallback_steps = 0
        self._errors = []
        self._used = False
        self._network = context.network
        self._shape = (context.network.n, N_SLOTS, N_FEATURES)
        self._fallback.reset(context)
        self.controller.reset(context)

    def decide(self, observation: Observation) -> IntArray:
        """(N,): legal phases."""
        phases = self._ask(observation.copy())
        illegal = phases < 0
        if not illegal.any():
            return phases
        self.fallback_steps += int(illegal.sum())
        return np.where(illegal, self._fallback.decide(observation), phases)

    def estimates(self) -> FloatArray | None:
        """(N, 12, F): the inner controller's, if the last step used its answer."""
        if not self._used:
            return None
        try:
            estimates = self.controller.estimates()
        except Exception as error:
            self._note(_one_line(error))
            return None
        if estimates is not None and np.shape(estimates) != self._shape:
            self._note(f"estimates must have the shape {self._shape}, not {np.shape(estimates)}")
            return None
        return estimates

    def plans(self) -> FloatArray | None:
        """(N, H, 12, F): the inner controller's, if the last step used its answer."""
        if not self._used:
            return None
        try:
            return self.controller.plans()
        except Exception as error:
            self._note(_one_line(error))
            return None

    def _ask(self, observation: Observation) -> IntArray:
        """(N,): the inner controller's phases, -1 where it gave none that is legal."""
        self._used = False
        nothing = np.full(self._network.n, -1, dtype=np.int64)
        began = self._clock()
        try:
            phases = legal_phases(self.controller.decide(observation), self._network)
        except Exception as error:
            self._note(_one_line(error))
            return nothing
        if self._clock() - began > self._deadline:
            self._note(f"later than the deadline of {self._deadline:g} s")
            return nothing
        if (phases < 0).any():
            self._note(f"no legal phase for {self._network.ids[int(np.argmin(phases))]}")
        self._used = True
        return phases

    def _note(self, text: str) -> None:
        if text not in self._errors and len(self._errors) < ERRORS_KEPT:
            self._errors.append(text)


class Fallback(Controller):
    """Max-queue on what is observed, the fixed-time plan where nothing is.

    Slots that did not report count as empty, but not for the maximum red of max-queue. It need
    not be asked at every step.
    """

    def __init__(self, max_red: float = 0) -> None:
        """Compose the two rules; ``max_red`` [s] as of ``bounded``."""
        self._max_queue = bounded(MaxQueue(), max_red)
        self._cycle = FixedTime()

    def reset(self, context: ControlContext) -> None:
        """Reset both rules."""
        self._slots = context.network.slot_mask
        self._max_queue.reset(context)
        self._cycle.reset(context)

    def decide(self, observation: Observation) -> IntArray:
        """(N,): max-queue's phases where any slot reported, the plan's elsewhere."""
        seen = (observation.mask & self._slots).any(axis=1)
        empty = observation.filled(
            np.nan_to_num(observation.values, nan=0.0), np.nan_to_num(observation.exits, nan=0.0)
        )
        return np.where(seen, self._max_queue.decide(empty), self._cycle.decide(observation))


def legal_phases(answer: object, network: Network) -> IntArray:
    """(N,): the answer as phases, -1 where an entry is none that the intersection has.

    Raises ``TypeError`` or ``ValueError`` if the answer is no array of N numbers.
    """
    array = np.asarray(answer)
    if array.dtype.kind not in "iuf":
        raise TypeError(f"phases must be integers, not {array.dtype}")
    if array.shape != (network.n,):
        raise ValueError(f"phases must have the shape ({network.n},), not {array.shape}")
    most = network.phase_mask.shape[1]
    known = (array >= 0) & (array < most) & (array == np.floor(array))
    phases = np.where(known, array, 0).astype(np.int64)
    return np.where(known & network.phase_mask[np.arange(network.n), phases], phases, -1)


def _one_line(error: Exception) -> str:
    """The error's type and text and the place where it was raised."""
    text = " ".join("".join(traceback.format_exception_only(error)).split())
    frames = traceback.extract_tb(error.__traceback__)
    return f"{text} ({Path(frames[-1].filename).name}:{frames[-1].lineno} in {frames[-1].name})"
