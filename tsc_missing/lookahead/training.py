"""Learning what phases lead to: episodes in the simulator, then a regression on them."""

import json
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, wait
from pathlib import Path
from typing import Any

import torch

from tsc_missing.config import SignalSettings
from tsc_missing.diffusion.weights import load_weights
from tsc_missing.errors import UserError
from tsc_missing.evaluation.scenario import find_scenario
from tsc_missing.files import (
    KEPT,
    check_begun_training,
    check_new_training,
    replace_file,
    sha256,
    written_into,
)
from tsc_missing.lookahead.believed import read_beliefs, write_beliefs
from tsc_missing.lookahead.config import LEARNING, LookaheadSettings
from tsc_missing.lookahead.episode import play_episode, read_played
from tsc_missing.lookahead.labelled import Labelled, labelled
from tsc_missing.lookahead.regression import Regression
from tsc_missing.lookahead.source import EPISODES, SETTINGS, Source, read_settings, read_source
from tsc_missing.processes import worker_processes
from tsc_missing.qlearning.networks import Graph, PhaseValue
from tsc_missing.qlearning.weights import load_q_network, save_q_network
from tsc_missing.versions import git_revision, versions
from tsc_missing.weights.find import FILE, MAKES_VALUES, find_weights
from tsc_missing.weights.inputs import check_inputs, of_scenarios, write_inputs

BELIEFS = "beliefs"
RENEW = 16  # episodes of a process, which then ends with the memory that SUMO has lost
PATIENCE = 0.5  # [s] between two looks whether to stop
LOG = 500  # updates between two reports

Watch = Callable[[int, str], None]  # (episodes that are there, what is going on)
Job = tuple[Any, ...]  # a function and its arguments


class _StoppedError(Exception):
    """Asked to stop."""


class LookaheadTraining:
    """A training in a folder: its episodes, what is believed in them, in the end the weights.

    Stopped at any moment it goes on with what is there; the weights depend on the settings only.
    """

    def __init__(self, settings: LookaheadSettings, folder: Path, resume: bool = False) -> None:
        """Check everything that can be wrong."""
        self.settings = settings
        self.folder = folder
        self._own = Source(folder, settings)
        self._sources = [self._own, *(read_source(other, settings) for other in settings.also)]
        nets = {net for source in self._sources for net in source.settings.nets}
        self._scenarios = {net: find_scenario(net, settings.demand) for net in sorted(nets)}
        base, self._base = load_q_network(find_weights(settings.base, MAKES_VALUES, "base"))
        if not isinstance(base, PhaseValue):
            raise UserError("base", settings.base, "it must be weights of the algorithm value")
        if base.history > settings.history:
            raise UserError("history", settings.history, f"the base looks back {base.history}")
        if base.certainty and (base.history, settings.masked) != (settings.history, True):
            words = f"the base looks back {base.history} and knows of missing data: so must this"
            raise UserError("history", settings.history, words)
        self._check_rewards()
        if settings.masked:
            check_looks_back(settings.history, settings.fill)
        self._start = base
        self._inputs = self._read_inputs()
        if resume:
            self._check_same()
            check_inputs(folder, self._inputs)
        else:
            check_new_training(folder)
        self.there = settings.episodes - len(self._own.missing)

    def run(
        self, workers: int, watch: Watch | None = None, stop: Callable[[], bool] = lambda: False
    ) -> Path | None:
        """Play, fill, then learn; returns the weights' file, or None where ``stop`` was true."""
        with written_into(self.folder, "out", KEPT):
            return self._run(workers, watch or (lambda there, what: None), stop)

    def _run(self, workers: int, tell: Watch, stop: Callable[[], bool]) -> Path | None:
        (self.folder / EPISODES).mkdir(parents=True, exist_ok=True)
        (self.folder / BELIEFS).mkdir(exist_ok=True)
        plan = json.dumps(self.settings.model_dump(mode="json"), indent=1)
        replace_file(self.folder / SETTINGS, plan.encode())
        write_inputs(self.folder, self._inputs)
        try:
            play = [
                (play_episode, self.settings, number, self._own.path(number))
                for number in self._own.missing
            ]
            for _ in _side_by_side(play, workers, stop):
                self.there += 1
                tell(self.there, "playing")
            for left in _side_by_side(self._to_fill(), workers, stop):
                tell(self.there, f"filling, {left} left")
            return self._learn(tell, stop)
        except _StoppedError:
            return None

    def _read_inputs(self) -> dict[str, str]:
        """All files that the result depends on, episodes of other trainings too, by checksum."""
        own = {net: scenario.checksums() for net, scenario in self._scenarios.items()}
        found = of_scenarios(own) | {"base": str(self._base["checksum"])}
        if self.settings.masked:
            found["fill"] = sha256(find_weights(self.settings.fill, field="fill"))
        for source in self._sources[1:]:
            paths = [source.path(number) for number in range(source.settings.episodes)]
            found |= {str(path): sha256(path) for path in paths}
        return found

    def _check_rewards(self) -> None:
        """Raise ``UserError`` where the base's values are of other rewards than are added here."""
        of_base = self._base.get("training", {})
        if of_base.get("reward") == "departures":
            raise UserError("base", self.settings.base, "its reward is departures, not vehicles")
        for name in ("discount", "running_weight", "reward_scale"):
            mine = getattr(self.settings, name)
            if of_base.get(name, mine) != mine:
                words = f"the base {self.settings.base} was trained with {of_base[name]}"
                raise UserError(name, mine, words)

    def _check_same(self) -> None:
        check_begun_training(self.folder, SETTINGS)
        before = read_settings(self.folder, "resume").model_dump(mode="json")
        for name, value in self.settings.model_dump(mode="json", exclude=set(LEARNING)).items():
            if value != before[name]:
                words = f"{self.folder} was begun with {before[name]}"
                raise UserError(name, value, words)

    def _all(self) -> list[tuple[int, int]]:
        """The places of sources, and the numbers of their episodes."""
        counts = [source.settings.episodes for source in self._sources]
        return [(place, k) for place, count in enumerate(counts) for k in range(count)]

    def _beliefs(self, place: int, number: int) -> Path:
        return self.folder / BELIEFS / f"{place}-{number:05d}.safetensors"

    def _to_fill(self) -> list[Job]:
        wanted = self._all() if self.settings.masked else []
        return [
            (fill_episode, self.settings, self._sources[place], number, path)
            for place, number in wanted
            if not (path := self._beliefs(place, number)).is_file()
        ]

    def _learn(self, tell: Watch, stop: Callable[[], bool]) -> Path:
        settings = self.settings
        learned: list[Labelled] = []
        held: list[Labelled] = []
        for place, number in self._all():
            kept = held if self._sources[place].is_held_out(number) else learned
            kept.append(self._read(place, number))
        if not any(len(episode.returns) for episode in learned):
            raise UserError("tried", settings.tried, "it must be larger: no phase was ever tried")
        graphs = {net: Graph.of(found.folder.network) for net, found in self._scenarios.items()}
        regression = Regression(settings, self._start, graphs, learned)
        for update in range(settings.updates):
            if stop():
                raise _StoppedError
            regression.update()
            if (update + 1) % LOG == 0:
                tell(self.there, f"learning {update + 1}/{settings.updates}")
        gained = {"learned": regression.gained(learned), "held_out": regression.gained(held)}
        tried = sum(len(episode.returns.flatten(0, 1)) for episode in learned)
        return self._write_weights(regression.average, gained, tried)

    def _read(self, place: int, number: int) -> Labelled:
        source = self._sources[place]
        network = self._scenarios[source.net(number)].folder.network
        return labelled(
            read_played(source.path(number), network),
            read_beliefs(self._beliefs(place, number)) if self.settings.masked else (),
            network,
            SignalSettings().decision_interval,
            self.settings.history,
            certainty=self.settings.masked,
        )

    def _write_weights(
        self, network: PhaseValue, gained: dict[str, dict[str, float]], tried: int
    ) -> Path:
        path = self.folder / FILE
        about = {
            "training": self.settings.model_dump(mode="json"),
            "base": self._base["checksum"],
            "also": [source.settings.model_dump(mode="json") for source in self._sources[1:]],
            "sources": {net: scenario.checksums() for net, scenario in self._scenarios.items()},
            "tried": tried,
            "gained": gained,
            "versions": versions(),
            "git": git_revision(),
        }
        save_q_network(network, "value", network.slot.width, path, about)
        return path


def check_looks_back(history: int, fill: str) -> None:
    """Raise ``UserError`` where the diffusion weights ``fill`` fill fewer steps than are used."""
    filled = load_weights(find_weights(fill, field="fill"))[0].config.history
    if 1 + history > filled:
        words = f"{fill} fills {filled} steps, so values can look back {filled - 1}"
        raise UserError("history", history, words)


def fill_episode(settings: LookaheadSettings, source: Source, number: int, path: Path) -> None:
    """Write what is believed in an episode; in a process of its own."""
    torch.set_num_threads(1)
    network = find_scenario(source.net(number), settings.demand).folder.network
    played = read_played(source.path(number), network)
    write_beliefs(path, settings, network, played, number)


def _side_by_side(jobs: list[Job], workers: int, stop: Callable[[], bool]) -> Iterator[int]:
    """Do jobs in processes that are replaced from time to time; gives how many are left."""
    left = len(jobs)
    for first in range(0, left, workers * RENEW):
        with worker_processes(workers) as pool:
            running = {pool.submit(*job) for job in jobs[first : first + workers * RENEW]}
            while running:
                if stop():
                    raise _StoppedError
                done, running = wait(running, PATIENCE, FIRST_COMPLETED)
                for job in done:
                    job.result()
                    left -= 1
                    yield left
