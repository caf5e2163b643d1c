"""The episodes that windows are drawn from at a training step: a bounded, sliding choice."""

import functools

import numpy as np
import numpy.typing as npt

from tsc_missing.network.model import BoolArray, IntArray
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.offline.joined import Episodes
from tsc_missing.offline.seen import saw_nothing
from tsc_missing.seeding import stream

VEHICLES, QUEUE, RED_STEPS, RECORDED = range(4)  # the columns of a cell


class EpisodePool:
    """At most ``resident`` episodes in memory, at places of equal size.

    Episodes come in the order of one random permutation after the other; every ``renew`` steps
    the oldest leaves for the next. Who is in at a step depends on the seed and the step only.
    """

    def __init__(self, dataset: Episodes, seed: int, resident: int, renew: int) -> None:
        """Nothing is read yet."""
        entries = dataset.episodes
        self._dataset = dataset
        self._seed = seed
        self._renew = renew
        self.size = min(resident, len(entries))
        self._slides = self.size < len(entries)
        self.rows = max(entry.steps * entry.intersections for entry in entries)
        self._at: list[int | None] = [None] * self.size  # position in the order, by place
        shape = (self.size * self.rows * N_SLOTS, 4)
        self.cells: npt.NDArray[np.float32] = np.zeros(shape, dtype=np.float32)
        self.phase: npt.NDArray[np.int8] = np.zeros(self.size * self.rows, dtype=np.int8)
        self.episode: IntArray = np.zeros(self.size, dtype=np.int64)  # by place
        self.sensed: list[IntArray] = [np.zeros(0, dtype=np.int64)] * self.size
        self.unaware: list[IntArray] = [np.zeros(0, dtype=np.int64)] * self.size  # by place
        most = max(entry.intersections for entry in entries)
        self.reports = np.zeros((self.size, most, N_SLOTS), dtype=bool)  # ever, in the episode

    def advance(self, step: int) -> None:
        """Have the episodes of a training step in memory."""
        first = step // self._renew if self._slides else 0
        for position in range(first, first + self.size):
            place = position % self.size
            if self._at[place] != position:
                self._load(place, self._episode(position))
                self._at[place] = position

    def _episode(self, position: int) -> int:
        cycle, index = divmod(position, len(self._dataset.episodes))
        return int(self._order(cycle)[index])

    @functools.lru_cache(maxsize=2)  # noqa: B019 - lives as long as the training
    def _order(self, cycle: int) -> IntArray:
        count = len(self._dataset.episodes)
        return stream(self._seed, f"episodes-{cycle}").permutation(count)

    def _load(self, place: int, episode: int) -> None:
        log = self._dataset.load(episode)
        rows = log.phase.size
        start = place * self.rows
        cells = self.cells[start * N_SLOTS : (start + rows) * N_SLOTS]
        cells[:, :RED_STEPS] = log.values.reshape(-1, 2)
        cells[:, RED_STEPS] = log.red_steps.ravel()
        cells[:, RECORDED] = log.recorded.ravel()
        self.phase[start : start + rows] = log.phase.ravel()
        self.episode[place] = episode
        spec = self._dataset.episodes[episode].spec
        network = self._dataset.networks[self._dataset.net(episode)]
        reports: BoolArray = np.any(log.recorded, axis=0)
        there = network.slot_mask
        self.unaware[place] = np.flatnonzero(
            saw_nothing(spec, network) & (reports & there).any(axis=1)
        )
        self.reports[place] = False
        self.reports[place, : len(reports)] = reports
        self.sensed[place] = np.flatnonzero((reports & there).any(axis=1))
