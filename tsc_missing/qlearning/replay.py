"""What happened, to learn from again: the steps of episodes, by network."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from tsc_missing.config import SignalSettings
from tsc_missing.network.model import Network
from tsc_missing.offline.log import EpisodeLog
from tsc_missing.qlearning.config import QLearningSettings
from tsc_missing.qlearning.features import SlotTables, log_features
from tsc_missing.qlearning.rewards import rewards


@dataclass(frozen=True)
class Transitions:
    """B decision steps of all N intersections of one network, and what came of them."""

    net: str
    before: Tensor  # (B, N, 12, ·) features
    phase: Tensor  # (B, N) that ran
    reward: Tensor  # (B, N) at the end of the step, scaled
    after: Tensor  # (B, N, 12, ·)


@dataclass(frozen=True)
class _Episode:
    net: str
    features: Tensor  # (T, N, 12, ·) half precision
    phase: Tensor  # (T, N)
    reward: Tensor  # (T - 1, N)


class Replay:
    """The latest episodes; steps of all of them are alike probable."""

    def __init__(
        self, networks: Mapping[str, Network], settings: QLearningSettings, most: int
    ) -> None:
        """At ``most`` so many episodes are kept."""
        interval = SignalSettings().decision_interval
        self._tables = {net: SlotTables.of(network, interval) for net, network in networks.items()}
        self._networks = networks
        self._settings = settings
        self._episodes: deque[_Episode] = deque(maxlen=most)

    def __len__(self) -> int:
        """Episodes."""
        return len(self._episodes)

    def add(self, net: str, log: EpisodeLog) -> None:
        """Take in an episode; the oldest leaves when there are too many."""
        features = log_features(
            self._tables[net], log.values, log.red_steps, self._settings.history
        )
        reward = rewards(log, self._networks[net], self._settings)
        self._episodes.append(
            _Episode(
                net,
                torch.from_numpy(features.astype(np.float16)),
                torch.from_numpy(log.phase),
                torch.from_numpy(reward),
            )
        )

    def sample(self, intersections: int, rng: np.random.Generator) -> list[Transitions]:
        """Steps with at least so many intersections in all, each network's together."""
        sizes = np.array([episode.reward.numel() for episode in self._episodes])
        steps: dict[str, list[tuple[_Episode, int]]] = {}
        total = 0
        while total < intersections:
            episode = self._episodes[rng.choice(len(sizes), p=sizes / sizes.sum())]
            steps.setdefault(episode.net, []).append(
                (episode, int(rng.integers(len(episode.reward))))
            )
            total += episode.reward.shape[1]
        return [_batch(net, chosen) for net, chosen in sorted(steps.items())]


def _batch(net: str, steps: list[tuple[_Episode, int]]) -> Transitions:
    return Transitions(
        net=net,
        before=torch.stack([episode.features[t] for episode, t in steps]).float(),
        phase=torch.stack([episode.phase[t] for episode, t in steps]),
        reward=torch.stack([episode.reward[t] for episode, t in steps]),
        after=torch.stack([episode.features[t + 1] for episode, t in steps]).float(),
    )
