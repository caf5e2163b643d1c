"""Learning what phases lead to: episodes in the simulator, then a regression on them."""

import json
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, wait
from pathlib import Path

from tsc_missing.config import SignalSettings
from tsc_missing.errors import UserError
from tsc_missing.evaluation.scenario import find_scenario
from tsc_missing.files import check_new_training, read_json, replace_file
from tsc_missing.lookahead.config import LEARNING, LookaheadSettings
from tsc_missing.lookahead.episode import Labelled, play_labelled, read_labelled
from tsc_missing.lookahead.regression import Regression
from tsc_missing.processes import worker_processes
from tsc_missing.qlearning.networks import Graph, PhaseValue
from tsc_missing.qlearning.weights import load_q_network, save_q_network
from tsc_missing.versions import git_revision, versions
from tsc_missing.weights.find import FILE, find_weights

EPISODES, SETTINGS = "episodes", "settings.json"
RENEW = 16  # episodes of a process, which then ends with the memory that SUMO has lost
PATIENCE = 0.5  # [s] between two looks whether to stop
LOG = 500  # updates between two reports

Watch = Callable[[int, str], None]  # (episodes that are there, what is going on)


class _StoppedError(Exception):
    """Asked to stop."""


class LookaheadTraining:
    """A training in a folder: its episodes, in the end the weights.

    Stopped at any moment it goes on with the episodes that are there; the weights depend on the
    settings only.
    """

    def __init__(self, settings: LookaheadSettings, folder: Path, resume: bool = False) -> None:
        """Check everything that can be wrong."""
        self.settings = settings
        self.folder = folder
        self._scenarios = {net: find_scenario(net, settings.demand) for net in settings.nets}
        base, self._base = load_q_network(find_weights(settings.base))
        if not isinstance(base, PhaseValue):
            raise UserError("base", settings.base, "it must be weights of the algorithm value")
        if base.history > settings.history:
            raise UserError("history", settings.history, f"the base looks back {base.history}")
        self._start = base
        if resume:
            self._check_same()
        else:
            check_new_training(folder)
        self.there = sum(self._episode(k).is_file() for k in range(settings.episodes))

    def run(
        self, workers: int, watch: Watch | None = None, stop: Callable[[], bool] = lambda: False
    ) -> Path | None:
        """Play, then learn; returns the weights' file, or None where ``stop`` was true."""
        try:
            (self.folder / EPISODES).mkdir(parents=True, exist_ok=True)
            plan = json.dumps(self.settings.model_dump(mode="json"), indent=1)
            replace_file(self.folder / SETTINGS, plan.encode())
        except OSError as error:
            words = f"cannot be written ({error.strerror})"
            raise UserError("out", self.folder, words) from error
        tell = watch or (lambda there, what: None)
        wanted = [k for k in range(self.settings.episodes) if not self._episode(k).is_file()]
        size = workers * RENEW
        try:
            for first in range(0, len(wanted), size):
                for _ in self._play(wanted[first : first + size], workers, stop):
                    self.there += 1
                    tell(self.there, "playing")
            return self._learn(tell, stop)
        except _StoppedError:
            return None

    def _episode(self, number: int) -> Path:
        return self.folder / EPISODES / f"{number:05d}.safetensors"

    def _check_same(self) -> None:
        before = read_json(self.folder / SETTINGS, "resume")
        for name, value in self.settings.model_dump(mode="json", exclude=set(LEARNING)).items():
            if value != before.get(name):
                words = f"{self.folder} was begun with {before.get(name)}"
                raise UserError(name, value, words)

    def _play(self, numbers: list[int], workers: int, stop: Callable[[], bool]) -> Iterator[int]:
        """Play episodes side by side; gives each as it ends."""
        with worker_processes(workers) as pool:
            running = {
                pool.submit(play_labelled, self.settings, number, self._episode(number)): number
                for number in numbers
            }
            while running:
                if stop():
                    raise _StoppedError
                for done in wait(running, PATIENCE, FIRST_COMPLETED).done:
                    done.result()
                    yield running.pop(done)

    def _learn(self, tell: Watch, stop: Callable[[], bool]) -> Path:
        settings = self.settings
        episodes = [self._read(number) for number in range(settings.episodes)]
        end = settings.episodes - settings.held_out
        learned, held = episodes[:end], episodes[end:]
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

    def _read(self, number: int) -> Labelled:
        network = self._scenarios[self.settings.nets[number % len(self.settings.nets)]].folder
        interval = SignalSettings().decision_interval
        return read_labelled(
            self._episode(number), network.network, interval, self.settings.history
        )

    def _write_weights(
        self, network: PhaseValue, gained: dict[str, float | None], tried: int
    ) -> Path:
        path = self.folder / FILE
        about = {
            "training": self.settings.model_dump(mode="json"),
            "base": self._base["checksum"],
            "sources": {net: scenario.checksums() for net, scenario in self._scenarios.items()},
            "tried": tried,
            "gained": gained,
            "versions": versions(),
            "git": git_revision(),
        }
        save_q_network(network, "value", network.slot.width, path, about)
        return path
