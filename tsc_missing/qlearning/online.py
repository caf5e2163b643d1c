"""Learning in the closed loop: rounds of episodes, and updates on what happened in them."""

from collections.abc import Callable, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from tsc_missing.config import RunSettings
from tsc_missing.errors import UserError
from tsc_missing.evaluation.scenario import find_scenario
from tsc_missing.files import KEPT, check_begun_training, check_new_training, sha256, written_into
from tsc_missing.network.model import Network
from tsc_missing.offline.dataset import Dataset, read_dataset
from tsc_missing.offline.episode import play
from tsc_missing.offline.log import EpisodeLog, read_log, write_log
from tsc_missing.offline.policies import Exploring
from tsc_missing.processes import worker_processes
from tsc_missing.qlearning.checkpoint import CHECKPOINT, load_learner, save_learner
from tsc_missing.qlearning.config import QLearningSettings
from tsc_missing.qlearning.controller import QPolicy
from tsc_missing.qlearning.learner import Learner
from tsc_missing.qlearning.networks import Graph, make_q_network
from tsc_missing.qlearning.replay import Replay, Transitions
from tsc_missing.qlearning.weights import save_q_network
from tsc_missing.seeding import stream
from tsc_missing.sensing.observation import VEHICLES
from tsc_missing.versions import git_revision, versions
from tsc_missing.weights.find import FILE, MAKES_VALUES, find_weights
from tsc_missing.weights.inputs import check_inputs, of_scenarios, write_inputs

EPISODES = "episodes"
RENEW = 16  # rounds after which processes are new, with the memory that SUMO has lost


@dataclass(frozen=True)
class Episode:
    """An episode to play with weights as they are."""

    settings: RunSettings
    algorithm: str
    width: int
    history: int
    weights: Mapping[str, Tensor]
    epsilon: float
    path: Path  # where its log goes


@dataclass(frozen=True)
class Seen:
    """The state of a training for who watches it."""

    round: int  # that is done
    rounds: int
    loss: float
    epsilon: float
    vehicles: float  # in the networks, mean over the round's episodes and steps


Watch = Callable[[Seen], None]


def play_episode(episode: Episode) -> None:
    """Run an episode and write its log."""
    torch.set_num_threads(1)
    settings = episode.settings
    q = make_q_network(episode.algorithm, episode.width, episode.history)
    q.load_state_dict(dict(episode.weights))
    policy = Exploring(QPolicy(q.eval(), episode.algorithm), episode.epsilon)
    log = play(find_scenario(settings.net, settings.demand), settings, policy)
    write_log(episode.path, log, {"net": settings.net})


def check_data(data: Dataset, algorithm: str, networks: Mapping[str, Network]) -> None:
    """Raise ``UserError`` unless its logs are whole, and of these networks where the names are."""
    if not data.manifest.complete:
        raise UserError("data", data.path, f"its logs have holes, and {algorithm} needs all")
    for net in networks.keys() & data.networks.keys():
        if data.networks[net].record != networks[net].record:
            raise UserError("data", data.path, f"its {net} is another network than {net} is now")


class QTraining:
    """A training in a folder: the logs of its episodes, a checkpoint, in the end the weights.

    The episodes of a round are played with the weights from before the updates of the round
    before, so that playing and learning go on at the same time and the result is still the same
    for the same seed.
    """

    def __init__(self, settings: QLearningSettings, folder: Path, resume: bool = False) -> None:
        """Check everything that can be wrong, and load the checkpoint to resume from."""
        self.settings = settings
        self.folder = folder
        scenarios = {net: find_scenario(net, settings.demand) for net in settings.nets}
        networks = {net: scenario.folder.network for net, scenario in scenarios.items()}
        self._scaled = {net for net, s in scenarios.items() if s.demand_kind == "profile"}
        self._sources = {net: scenario.checksums() for net, scenario in scenarios.items()}
        self._data = None if settings.data is None else read_dataset(settings.data)
        if self._data is not None:
            check_data(self._data, settings.algorithm, networks)
            networks |= self._data.networks
        torch.manual_seed(int(stream(settings.seed, "weights").integers(2**31)))
        graphs = {net: Graph.of(network) for net, network in networks.items()}
        self.learner = Learner(settings, graphs)
        if settings.start is not None:
            self.learner.begin_with(find_weights(settings.start, MAKES_VALUES, "start"))
        self._own = Replay(networks, settings, settings.memory)
        self._given = Replay(networks, settings, 10**6)
        self.round = 0
        self._inputs = of_scenarios(self._sources)
        if self._data is not None:
            self._inputs["data"] = self._data.checksum
        if settings.start is not None:
            self._inputs["start"] = sha256(find_weights(settings.start))
        if resume:
            check_begun_training(folder, CHECKPOINT)
            check_inputs(folder, self._inputs)
            self.round = load_learner(folder, settings, self.learner)
        else:
            check_new_training(folder)

    def run(
        self, workers: int, watch: Watch | None = None, stop: Callable[[], bool] = lambda: False
    ) -> Path | None:
        """Learn to the last round; returns the weights' file, or None where ``stop`` was true."""
        with written_into(self.folder, "out", KEPT):
            return self._run(workers, watch, stop)

    def _run(self, workers: int, watch: Watch | None, stop: Callable[[], bool]) -> Path | None:
        (self.folder / EPISODES).mkdir(parents=True, exist_ok=True)
        new = self.round == 0 and self.learner.done == 0
        if new:  # something to go on from, before what may take minutes
            save_learner(self.folder, self.settings, self.learner, 0)
        write_inputs(self.folder, self._inputs)
        self._load()
        if new:
            self._learn(self.settings.before, "before")
            self.learner.act_as_now()
            save_learner(self.folder, self.settings, self.learner, 0)
        while self.round < self.settings.rounds:
            last = min(self.settings.rounds, self.round + RENEW)
            with ExitStack() as stack:
                pool = stack.enter_context(worker_processes(workers))
                playing = self._play(pool, self.round)
                while self.round < last:
                    if stop():
                        return None
                    playing = self._round(pool, playing, last, watch)
        return self._write_weights()

    def _round(
        self, pool: ProcessPoolExecutor, playing: list[Future[None]], last: int, watch: Watch | None
    ) -> list[Future[None]]:
        """Take in the round that is being played, start the next, and learn meanwhile."""
        for future in playing:
            future.result()
        vehicles = [self._take(self.round, k) for k in range(self.settings.episodes)]
        self.learner.act_as_now()
        following = self._play(pool, self.round + 1) if self.round + 1 < last else []
        loss = self._learn(self.settings.updates, f"round-{self.round}")
        epsilon = self.settings.epsilon(self.round)
        self.round += 1
        if watch is not None:
            mean = float(np.mean(vehicles))
            watch(Seen(self.round, self.settings.rounds, loss, epsilon, mean))
        save_learner(self.folder, self.settings, self.learner, self.round)
        return following

    def _play(self, pool: ProcessPoolExecutor, number: int) -> list[Future[None]]:
        weights = {name: x.clone() for name, x in self.learner.acting.state_dict().items()}
        return [
            pool.submit(play_episode, self._episode(number, k, weights))
            for k in range(self.settings.episodes)
        ]

    def _episode(self, number: int, k: int, weights: Mapping[str, Tensor]) -> Episode:
        settings = self.settings
        rng = stream(settings.seed, f"episode-{number}-{k}")
        index = number * settings.episodes + k
        net = settings.nets[index % len(settings.nets)]
        volume = round(float(rng.uniform(settings.volume_min, settings.volume_max)), 4)
        run = RunSettings(
            net=net,
            demand=settings.demand,
            volume=volume if net in self._scaled else 1.0,
            horizon=settings.horizon,
            seed=int(rng.integers(2**31)),
        )
        epsilon = settings.epsilon(number)
        path = self._log(number, k)
        shape = settings.algorithm, settings.width, settings.history
        return Episode(run, *shape, weights, epsilon, path)

    def _log(self, number: int, k: int) -> Path:
        return self.folder / EPISODES / f"{number:05d}-{k}.parquet"

    def _load(self) -> None:
        """Read the dataset, and the own episodes that were there before."""
        if self._data is not None:
            for number, entry in enumerate(self._data.manifest.episodes):
                self._given.add(entry.spec.net, self._data.load(number))
        for number in range(self.round):
            for k in range(self.settings.episodes):
                self._take(number, k)

    def _take(self, number: int, k: int) -> float:
        """Take an episode's log into the memory; the mean of vehicles in the network."""
        log, about = read_log(self._log(number, k))
        self._own.add(about["net"], log)
        return _mean_vehicles(log)

    def _learn(self, updates: int, name: str) -> float:
        """The mean loss of some updates."""
        rng = stream(self.settings.seed, f"updates-{name}")
        losses = [self.learner.update(self._batch(rng)) for _ in range(updates)]
        return float(np.mean(losses)) if losses else 0.0

    def _batch(self, rng: np.random.Generator) -> list[Transitions]:
        batch, share = self.settings.batch, self.settings.own_share
        own = 0 if not len(self._own) else round(batch * (share if len(self._given) else 1.0))
        parts = self._own.sample(own, rng) if own else []
        return parts + (self._given.sample(batch - own, rng) if batch > own else [])

    def _write_weights(self) -> Path:
        settings = self.settings
        path = self.folder / FILE
        about = {
            "training": settings.model_dump(mode="json", exclude={"data"}),
            "data": None if self._data is None else self._data.checksum,
            "sources": self._sources,
            "updates": self.learner.done,
            "versions": versions(),
            "git": git_revision(),
        }
        save_q_network(self.learner.target, settings.algorithm, settings.width, path, about)
        return path


def _mean_vehicles(log: EpisodeLog) -> float:
    return float(log.values[..., VEHICLES].sum(axis=(1, 2)).mean())
