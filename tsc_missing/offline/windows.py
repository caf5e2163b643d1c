"""Random windows of a dataset, as the diffusion model trains on them."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from tsc_missing.diffusion.batch import group_table
from tsc_missing.diffusion.windows import Windows
from tsc_missing.errors import UserError
from tsc_missing.network.model import BoolArray, IntArray, Network
from tsc_missing.network.slots import APPROACHES, MAX_NEIGHBOURS, N_SLOTS
from tsc_missing.offline.joined import Episodes
from tsc_missing.offline.log import FIELD
from tsc_missing.offline.pool import RECORDED, RED_STEPS, EpisodePool
from tsc_missing.offline.window_masks import MaskMix, WindowMasks, draw_masks
from tsc_missing.seeding import stream

NOTHING = "it must have something recorded"


@dataclass(frozen=True)
class Draw:
    """Which windows: places in the pool, intersections, first steps (may be before the episode)."""

    place: IntArray  # (B,)
    intersection: IntArray  # (B,)
    start: IntArray  # (B,)


class WindowSampler:
    """Draws windows of T = C + H steps; the same for the same seed and training step.

    A window is an episode of the pool, an intersection with a sensor and a first step, all alike
    probable. The first step may lie up to C - 1 steps before the episode: what was then is not
    recorded. Masks are drawn for each window by ``mix``. ``told_all`` is the share of windows
    whose neighbours tell all that is recorded, the future too, as generated trajectories do when
    deciding; in the others they tell what their own sensors saw up to now.
    """

    def __init__(
        self,
        dataset: Episodes,
        history: int,
        horizon: int,
        mix: MaskMix,
        seed: int,
        told_all: float = 0.5,
        resident: int = 128,
        renew: int = 4,
    ) -> None:
        """``resident`` and ``renew``: see ``EpisodePool``."""
        self._path = dataset.path
        self._history = history
        self._length = history + horizon
        shortest = min(entry.steps for entry in dataset.episodes)
        if shortest < self._length:
            raise UserError(
                FIELD, dataset.path, f"episodes must have at least {self._length} steps"
            )
        if not any(entry.statistics.cells for entry in dataset.episodes):
            raise UserError(FIELD, dataset.path, NOTHING)
        self._mix = mix
        self._seed = seed
        self._told_all = told_all
        self._pool = EpisodePool(dataset, seed, resident, renew)
        self._cells = torch.from_numpy(self._pool.cells)
        entries = dataset.episodes
        self._steps = np.array([entry.steps for entry in entries])
        nets = list(dataset.networks)
        self._tables = _Tables([dataset.networks[net] for net in nets])
        self._net = np.array([nets.index(dataset.net(k)) for k in range(len(entries))])

    def sample(self, step: int, count: int) -> Windows:
        """The ``count`` windows of a training step."""
        self._pool.advance(step)
        rng = stream(self._seed, f"windows-{step}")
        return self.windows(self.draw(count, rng), rng)

    def draw(self, count: int, rng: np.random.Generator) -> Draw:
        """Which windows to take of the pool's episodes."""
        pool = self._pool
        usable = np.flatnonzero([len(sensed) > 0 for sensed in pool.sensed])
        if not len(usable):
            raise UserError(FIELD, self._path, NOTHING)
        place = usable[rng.integers(len(usable), size=count)]
        which, where = rng.random((2, count))
        sizes = np.array([len(sensed) for sensed in pool.sensed])
        offsets = np.cumsum(sizes) - sizes
        listed = np.concatenate(pool.sensed)
        intersection = listed[offsets[place] + (which * sizes[place]).astype(np.int64)]
        before = self._history - 1
        starts = self._steps[pool.episode[place]] - self._length + 1 + before
        return Draw(place, intersection, (where * starts).astype(np.int64) - before)

    def windows(self, draw: Draw, rng: np.random.Generator) -> Windows:
        """The windows of a draw with masks from ``rng``."""
        pool, tables, count = self._pool, self._tables, len(draw.place)
        net = self._net[pool.episode[draw.place]]
        masks = draw_masks(self._mix, draw.intersection, rng)
        draw = self._where_blind(draw, masks.own_blind, rng)
        masks = replace(masks, own=draw.intersection)
        index = tables.offset[net] + draw.intersection
        time = draw.start[:, None] + np.arange(self._length)  # (B, T)
        within = time >= 0
        rows = draw.place[:, None] * pool.rows + np.maximum(time, 0) * tables.n[net][:, None]
        own = (rows + draw.intersection[:, None])[..., None] * N_SLOTS + np.arange(N_SLOTS)
        values, recorded, green, red = self._gather(own, within[..., None])
        here = np.broadcast_to(draw.intersection[:, None], (count, N_SLOTS))
        seen = masks.seen(here, tables.common[index], self._length).transpose(0, 2, 1)
        everything = rng.random(count) < self._told_all
        telling = _Telling(rows, within, masks, everything, tables.offset[net])
        near = self._told(telling, tables.neighbours[index])
        down = self._told(telling, tables.downstream[index])
        now = rows[:, self._history - 1] + draw.intersection
        reports = pool.reports[draw.place, draw.intersection]
        return Windows(
            values=values,
            recorded=recorded,
            hidden=_tensor(~seen),
            observable=_tensor(reports & ~masks.own_blind[:, None]),
            green=green,
            red_steps=red,
            slots=_tensor(tables.slots[index]),
            phases=_tensor(tables.phases[index]),
            phase_mask=_tensor(tables.phase_mask[index]),
            action=_tensor(pool.phase[now].astype(np.int64)),
            near_values=near.values,
            near_given=near.given,
            near_green=near.green,
            near_red_steps=near.red_steps,
            near_exists=near.exists,
            down_values=down.values,
            down_given=down.given,
            down_exists=down.exists,
        )

    def _where_blind(self, draw: Draw, blind: BoolArray, rng: np.random.Generator) -> Draw:
        """Move windows that see nothing to intersections whose policy saw nothing either.

        Where an episode has none, the window stays where it is.
        """
        listed = [self._pool.unaware[place] for place in draw.place]
        sizes = np.array([len(some) for some in listed])
        which = (rng.random(len(sizes)) * sizes).astype(np.int64)
        moved = [
            some[k] if hidden and len(some) else n
            for some, k, hidden, n in zip(listed, which, blind, draw.intersection, strict=True)
        ]
        return replace(draw, intersection=np.array(moved, dtype=np.int64))

    def _told(self, telling: "_Telling", table: IntArray) -> "_Told":
        """What the slots of ``table`` (B, …), flat and -1 for none, tell over the T steps."""
        exists = table >= 0
        other = np.maximum(table, 0)
        steps = (len(table), *[1] * (table.ndim - 1), self._length)
        cells = telling.rows.reshape(steps) * N_SLOTS + other[..., None]
        values, recorded, green, red = self._gather(cells, telling.within.reshape(steps))
        index = telling.offset.reshape(steps[:-1]) + other // N_SLOTS
        common = self._tables.common[index, other % N_SLOTS]
        told = telling.masks.seen(other // N_SLOTS, common, self._length)
        told &= np.arange(self._length) < self._history
        told |= telling.everything.reshape(steps[:-1])[..., None]
        given = recorded & _tensor(told & exists[..., None])
        return _Told(values, given, green, red, _tensor(exists))

    def _gather(self, cells: IntArray, within: BoolArray) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Values (…, F), recorded, green and red steps (…) of cells (…) of the pool.

        Where not ``within`` the episode nothing is recorded, and the signals stand as they do in
        its first step, which ``cells`` must point to (as ``controllers.recent`` has it in a run).
        """
        flat = self._cells.index_select(0, _tensor(cells.ravel()))
        found = flat.view(*cells.shape, flat.shape[-1])
        red = found[..., RED_STEPS]
        recorded = (found[..., RECORDED] > 0) & _tensor(within)
        return found[..., :RED_STEPS], recorded, red == 0, red


@dataclass(frozen=True)
class _Telling:
    """What others tell a window."""

    rows: IntArray  # (B, T) the first row of each step in the pool
    within: BoolArray  # (B, T)
    masks: WindowMasks
    everything: BoolArray  # (B,) whether they tell all that is recorded
    offset: IntArray  # (B,) of the window's network in the tables


@dataclass(frozen=True)
class _Told:
    """The cells (B, …, T) of other slots."""

    values: Tensor  # (B, …, T, F)
    given: Tensor
    green: Tensor
    red_steps: Tensor
    exists: Tensor  # (B, …)


class _Tables:
    """The tables of several networks one after the other, with phases padded to the most."""

    def __init__(self, networks: list[Network]) -> None:
        self.n = np.array([network.n for network in networks])
        self.offset = np.cumsum(self.n) - self.n
        self.slots = np.concatenate([network.slot_mask for network in networks])
        self.common = np.concatenate([network.slots_in_common for network in networks])
        most = max(network.phase_mask.shape[1] for network in networks)

        def padded(table: BoolArray) -> BoolArray:
            widths = [(0, 0)] * table.ndim
            widths[1] = (0, most - table.shape[1])
            return np.pad(table, widths)

        self.phases = np.concatenate([padded(network.phases) for network in networks])
        self.phase_mask = np.concatenate([padded(network.phase_mask) for network in networks])
        self.neighbours = _neighbour_tables(networks)
        self.downstream = _downstream_tables(networks)


def _neighbour_tables(networks: list[Network]) -> IntArray:
    """(sum of N, G, 3): grouped by approach where that can be done in every network."""
    grouped = [
        group_table(_tensor(network.neighbours), _tensor(network.slot_mask)).numpy()
        for network in networks
    ]
    if any(table.shape[1] != len(APPROACHES) for table in grouped):
        grouped = [network.neighbours for network in networks]
    return np.concatenate(grouped).reshape(-1, grouped[0].shape[1], MAX_NEIGHBOURS)


def _downstream_tables(networks: list[Network]) -> IntArray:
    """(sum of N, 12, D)."""
    most = max(network.downstream.shape[2] for network in networks)
    return np.concatenate(
        [
            np.pad(
                network.downstream,
                ((0, 0), (0, 0), (0, most - network.downstream.shape[2])),
                constant_values=-1,
            )
            for network in networks
        ]
    )


def _tensor(array: npt.NDArray[np.generic]) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(array))
