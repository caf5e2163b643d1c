"""The logs of a dataset as tensors, and samples of successive steps from them."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import torch
from torch import Tensor

from tsc_missing.baselines.config import BaselineSettings
from tsc_missing.config import SignalSettings
from tsc_missing.errors import UserError
from tsc_missing.imputation.store_and_forward import StoreAndForward
from tsc_missing.network.model import Network
from tsc_missing.offline.dataset import Dataset
from tsc_missing.offline.fill import fill_log
from tsc_missing.offline.log import FIELD, EpisodeLog
from tsc_missing.qlearning.features import NAMES, VEHICLE_SCALE, SlotTables, slot_features
from tsc_missing.qlearning.networks import Graph
from tsc_missing.qlearning.rewards import queue_reward
from tsc_missing.seeding import stream

QUEUE_COLUMN, RUNNING_COLUMN = NAMES.index("queue"), NAMES.index("running")
HELD_OUT = 8192  # samples that the numbers on held-out episodes are of, at most
PART = 2048  # samples of one evaluation at a time


@dataclass(frozen=True)
class Steps:
    """B stretches of K successive decision steps of all N intersections of one network.

    Steps before an episode began are padding: zeros, with ``there`` false. ``phase`` and
    ``reward`` of a step are what came of it, so a decision does not know those of the last step.
    """

    graph: Graph
    features: Tensor  # (B, K, N, 12, N_NAMES) as ``qlearning.features`` makes them
    phase: Tensor  # (B, K, N) that ran from each step on; -1 where not known
    reward: Tensor  # (B, K, N) at the end of each step, scaled; 0 where not known
    known: Tensor  # (B, K, N) bool: all slots of the intersection reported at the step
    there: Tensor  # (B, K) bool
    position: Tensor  # (B, K) of the step in its episode
    earned: Tensor  # (B, K, N) the sum of the rewards before each step
    to_go: Tensor  # (B, K, N) the mean of those from it on, by their discounts; NaN in a run

    @property
    def values(self) -> Tensor:
        """(B, K, N, 12, F) [vehicles]: vehicles and queue of the slots."""
        queue = self.features[..., QUEUE_COLUMN]
        vehicles = queue + self.features[..., RUNNING_COLUMN]
        return torch.stack((vehicles, queue), dim=-1) * VEHICLE_SCALE

    def first(self, count: int) -> "Steps":
        """The first ``count`` of the K steps."""
        parts = {
            f.name: getattr(self, f.name)[:, :count] for f in fields(self) if f.name != "graph"
        }
        return replace(self, **parts)

    @property
    def samples(self) -> int:
        """Stretches times intersections, B * N."""
        return self.phase.shape[0] * self.phase.shape[2]


@dataclass(frozen=True)
class _Rows:
    """All steps of a network's S = T_1 + T_2 + … steps, episode after episode."""

    graph: Graph
    features: Tensor  # (S, N, 12, N_NAMES) half precision
    phase: Tensor  # (S, N)
    reward: Tensor  # (S, N)
    earned: Tensor  # (S, N)
    to_go: Tensor  # (S, N)
    known: Tensor  # (S, N)
    position: Tensor  # (S,) of the step in its episode
    ends: Tensor  # (E,) rows that a stretch may end at


class Logs:
    """Episodes to sample stretches of ``length`` steps from."""

    def __init__(
        self,
        episodes: Mapping[str, Sequence[EpisodeLog]],
        networks: Mapping[str, Network],
        settings: BaselineSettings,
        length: int,
        padded: bool,
        ahead: int = 0,
        discount: float = 1.0,
    ) -> None:
        """``episodes`` by network; ``padded`` stretches may reach back to before an episode.

        These have at least ``ahead + 1`` steps of it. ``discount`` is that of ``to_go``. Holes
        are filled by store-and-forward (k = 12). Raises ``UserError`` where no episode is long
        enough.
        """
        self._length = length
        self._rows = []
        least = ahead + 1 if padded else length
        for net, logs in sorted(episodes.items()):
            rows = _rows(networks[net], logs, settings, least, discount)
            if len(rows.ends):
                self._rows.append(rows)
        if not self._rows:
            raise UserError(FIELD, settings.data, f"no episode has {least} steps")
        sizes = np.array([len(rows.ends) * rows.phase.shape[1] for rows in self._rows])
        self._shares = sizes / sizes.sum()

    def sample(self, samples: int, rng: np.random.Generator) -> Steps:
        """Stretches of one network with at least so many samples; all are alike probable."""
        rows = self._rows[rng.choice(len(self._rows), p=self._shares)]
        count = math.ceil(samples / rows.phase.shape[1])
        return self._steps(rows, rows.ends[rng.integers(len(rows.ends), size=count)])

    @property
    def rewards(self) -> int:
        """Steps of an intersection whose beginning and end were observed in full."""
        return sum(
            int((rows.known[:-1] & rows.known[1:])[rows.position[1:] > 0].sum())
            for rows in self._rows
        )

    @property
    def steps(self) -> int:
        """Of the longest episode."""
        return max(int(rows.position.max()) + 1 for rows in self._rows)

    def returns(self, whole: bool) -> Tensor:
        """(R,): ``to_go`` of all intersections, at the first steps of ``whole`` episodes or all."""
        found = [rows.to_go[rows.position == 0] if whole else rows.to_go for rows in self._rows]
        return torch.cat([values.flatten() for values in found])

    def spread(self, most: int = HELD_OUT, part: int = PART) -> Iterator[Steps]:
        """Stretches evenly spread over all episodes, about ``most`` samples, in parts."""
        for rows, share in zip(self._rows, self._shares, strict=True):
            n = rows.phase.shape[1]
            every = max(1, math.ceil(len(rows.ends) * n / max(most * share, 1)))
            for ends in torch.split(rows.ends[::every], max(1, part // n)):
                yield self._steps(rows, ends)

    def _steps(self, rows: _Rows, ends: Tensor) -> Steps:
        """The stretches that end at the rows ``ends`` (B,)."""
        back = torch.arange(self._length - 1, -1, -1)
        there = rows.position[ends, None] >= back  # (B, K)
        at = (ends[:, None] - back).clamp(min=0)
        all_n = there[:, :, None]
        return Steps(
            graph=rows.graph,
            features=rows.features[at].float() * all_n[..., None, None],
            phase=torch.where(all_n, rows.phase[at], -1),
            reward=rows.reward[at] * all_n,
            known=rows.known[at] & all_n,
            there=there,
            position=rows.position[at] * there,
            earned=rows.earned[at] * all_n,
            to_go=rows.to_go[at] * all_n,
        )


def read_logs(
    dataset: Dataset,
    settings: BaselineSettings,
    length: int,
    padded: bool,
    ahead: int = 0,
    discount: float = 1.0,
) -> tuple[Logs, Logs]:
    """The episodes to learn from, and those held out: of each network the same share.

    The stretches in them are as ``Logs`` describes them. Raises ``UserError`` where no network
    has two episodes.
    """
    by_net: dict[str, list[int]] = {}
    for number, entry in enumerate(dataset.manifest.episodes):
        by_net.setdefault(entry.spec.net, []).append(number)
    learn: dict[str, list[EpisodeLog]] = {}
    held: dict[str, list[EpisodeLog]] = {}
    for net, numbers in by_net.items():
        order = stream(settings.seed, f"held-out-{net}").permutation(numbers)
        most = len(order) - 1
        count = min(most, max(1, round(settings.held_out * len(order))))
        for k, number in enumerate(order):
            (held if k < count else learn).setdefault(net, []).append(dataset.load(int(number)))
    if not held:
        raise UserError(FIELD, dataset.path, "it needs two episodes of a network: one is held out")
    made = (
        Logs(part, dataset.networks, settings, length, padded, ahead, discount)
        for part in (learn, held)
    )
    return next(made), next(made)


def _rows(
    network: Network,
    logs: Sequence[EpisodeLog],
    settings: BaselineSettings,
    least: int,
    discount: float,
) -> _Rows:
    """The steps of a network's episodes; stretches have at least ``least`` real steps."""
    tables = SlotTables.of(network, SignalSettings().decision_interval)
    filled = [fill_log(log, network, StoreAndForward()) for log in logs]
    features = [slot_features(tables, log.values, log.red_steps) for log in filled]
    position = np.concatenate([np.arange(len(log.phase)) for log in logs])
    rewards = [_rewards(log, settings) for log in filled]
    return _Rows(
        graph=Graph.of(network),
        features=torch.from_numpy(np.concatenate(features).astype(np.float16)),
        phase=torch.from_numpy(np.concatenate([log.phase for log in logs])),
        reward=torch.from_numpy(np.concatenate(rewards)),
        earned=torch.from_numpy(np.concatenate([np.cumsum(r, axis=0) - r for r in rewards])),
        to_go=torch.from_numpy(np.concatenate([_to_go(r, discount) for r in rewards])),
        known=torch.from_numpy(np.concatenate([log.recorded.all(axis=2) for log in logs])),
        position=torch.from_numpy(position),
        ends=torch.from_numpy(np.flatnonzero(position >= least - 1)),
    )


def _rewards(log: EpisodeLog, settings: BaselineSettings) -> np.ndarray:
    """(T, N): of each step; 0 for the last, whose end is not in the log."""
    after = queue_reward(log.values[1:], settings.running_weight) / settings.reward_scale
    return np.concatenate((after, np.zeros_like(log.phase[:1]))).astype(np.float32)


def served_slots(graph: Graph, phase: Tensor) -> Tensor:
    """(…, N, 12): 1 where a phase (…, N) serves a slot; zeros for the phase -1."""
    everyone = torch.arange(len(graph.phases))
    found: Tensor = graph.phases[everyone, phase.clamp(min=0)] & (phase >= 0).unsqueeze(-1)
    return found.float()


def _to_go(rewards: np.ndarray, discount: float) -> np.ndarray:
    """(T, N): the mean of rewards (T, N) from each step on, by their discounts.

    As a mean it says the same near the end of an episode as far from it. The reward of the last
    step is not known; what is to go from it on stays that of the step before.
    """
    total, weight = np.zeros_like(rewards), np.zeros((len(rewards), 1), rewards.dtype)
    for t in range(len(rewards) - 2, -1, -1):
        total[t] = rewards[t] + discount * total[t + 1]
        weight[t] = 1 + discount * weight[t + 1]
    mean: np.ndarray = total / np.maximum(weight, 1)
    mean[-1:] = mean[-2:-1] if len(mean) > 1 else 0.0
    return mean
