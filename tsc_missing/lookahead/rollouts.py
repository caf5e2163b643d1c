"""What each phase would lead to, found out by simulating on from the present with it."""

from collections import deque
from pathlib import Path

import numpy as np

from tsc_missing.controllers.spillback import Room
from tsc_missing.evaluation.closed_loop import Moment
from tsc_missing.evaluation.steps import run_step
from tsc_missing.lookahead.config import LookaheadSettings
from tsc_missing.network.model import BoolArray, FloatArray, IntArray, Network
from tsc_missing.qlearning.controller import PhaseValues
from tsc_missing.qlearning.networks import QNetwork
from tsc_missing.qlearning.rewards import queue_reward
from tsc_missing.sensing.observation import VEHICLES


class Lookahead:
    """Tries all phases of all intersections at some of a run's decision steps.

    Tried at the start of step t, phase a of an intersection is worth

        G(a) = Σ_{d<D} γ^d r_{t+d+1} + γ^D max_a' Q(s_{t+D}, a'),

    where a runs in step t and everything else is decided by the best values of Q, with room kept on
    short roads if so wanted: one step of rollout policy improvement (Tesauro and Galperin, NeurIPS
    1996) with the same arrivals for all phases. No two adjacent intersections try at a time, so
    each has to do with its own phase only. The simulation is afterwards as it was, but for what
    SUMO leaves out of its saved states: a vehicle that waits to enter may enter a step later.
    """

    def __init__(
        self,
        q: QNetwork,
        network: Network,
        interval: float,
        settings: LookaheadSettings,
        random: np.random.Generator,
        folder: Path,
        room: Room | None = None,
    ) -> None:
        """``interval`` [s] between decisions; ``random`` chooses the steps.

        A file in ``folder`` holds the simulation's state meanwhile. ``room`` is kept by all.
        """
        self._network = network
        self._interval = interval
        self._settings = settings
        self._random = random
        self._values = PhaseValues(q, network, interval)
        self._seen: deque[tuple[FloatArray, IntArray]] = deque(maxlen=1 + q.history)
        self._room = room
        self._groups = apart(network)
        self._file = folder / "present.xml"
        self.returns: dict[int, FloatArray] = {}  # by step: (N, P), NaN without the phase

    def __call__(self, moment: Moment) -> None:
        """Note what is seen, and at some steps try all phases."""
        self._seen.append((moment.truth.values, moment.signals.red_steps))
        if self._random.random() < self._settings.tried:
            self.returns[moment.step] = self._try_all(moment)

    def _try_all(self, moment: Moment) -> FloatArray:
        """(N, P)."""
        best = self._decided(self._scores(self._seen), moment.truth.values)
        others = _others(self._network.phase_mask, best)
        moment.simulation.save(self._file)
        found = np.full(self._network.phase_mask.shape, np.nan)
        found[np.arange(len(best)), best] = self._follow(moment, best)
        for group in self._groups:
            for phases in others.T:
                trying = np.flatnonzero(group & (phases >= 0))
                if len(trying):
                    first = best.copy()
                    first[trying] = phases[trying]
                    found[trying, phases[trying]] = self._follow(moment, first)[trying]
        return found

    def _follow(self, moment: Moment, phases: IntArray) -> FloatArray:
        """(N,): the discounted rewards from here on, beginning with ``phases`` (N,)."""
        settings, signals, seen = self._settings, moment.signals.fork(), self._seen.copy()
        total, scores = np.zeros(len(phases)), np.zeros((len(phases), 1))
        for ahead in range(settings.depth):
            now = (moment.step + ahead) * self._interval
            run_step(moment.simulation, signals, phases, now, now + self._interval)
            values = moment.detectors.read().values
            seen.append((values, signals.red_steps))
            reward = queue_reward(values, settings.running_weight) / settings.reward_scale
            total += settings.discount**ahead * reward
            scores = self._scores(seen)
            phases = self._decided(scores, values)
        moment.simulation.restore(self._file)
        moment.signals.repeat()
        return np.asarray(total + settings.discount**settings.depth * scores.max(axis=1))

    def _decided(self, scores: FloatArray, values: FloatArray) -> IntArray:
        """(N,): the phases that run, by ``scores`` (N, P) and the present ``values`` (N, 12, F)."""
        best = scores.argmax(axis=1)
        return best if self._room is None else self._room.kept(best, values[:, :, VEHICLES])

    def _scores(self, seen: deque[tuple[FloatArray, IntArray]]) -> FloatArray:
        values, red_steps = zip(*seen, strict=True)
        return self._values.of(np.stack(values), np.stack(red_steps))


def apart(network: Network) -> list[BoolArray]:
    """Groups (N,) of intersections of which no two are adjacent; each is in one of them."""
    group = np.full(network.n, -1)
    for n in range(network.n):
        taken = set(group[network.adjacency[n]])
        group[n] = next(number for number in range(network.n) if number not in taken)
    return [group == number for number in range(group.max() + 1)]


def _others(phase_mask: BoolArray, best: IntArray) -> IntArray:
    """(N, P - 1): the phases that an intersection has beside ``best``, then -1."""
    rest = phase_mask.copy()
    rest[np.arange(len(best)), best] = False
    order = np.argsort(~rest, axis=1, kind="stable")[:, : phase_mask.shape[1] - 1]
    return np.where(np.take_along_axis(rest, order, axis=1), order, -1)
