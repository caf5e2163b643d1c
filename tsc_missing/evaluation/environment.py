"""The closed loop as a Gymnasium environment, for agents that learn in it."""

import contextlib
import os
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from tsc_missing.config import SEEDS, RunSettings
from tsc_missing.controllers.diffusion_weights import diffusion_of
from tsc_missing.controllers.fallback import legal_phases
from tsc_missing.errors import UserError
from tsc_missing.evaluation.episode import Episode
from tsc_missing.evaluation.run import check_timing, scene_of
from tsc_missing.evaluation.scenario import find_scenario
from tsc_missing.imputation.registry import make_imputer
from tsc_missing.network.model import IntArray
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.sensing.observation import QUEUE, VEHICLES
from tsc_missing.simulation.engine import EngineName

Answer = dict[str, Any]


class SignalEnv(gymnasium.Env[Answer, IntArray]):
    """A run whose phases an agent chooses: one action for all N intersections each step.

    The same loop as that of ``tsc-run``: demand, mask, sensors, yellows and minimum greens. The
    rules that bound a controller there bound the agent here: ``max_red``, ``min_space`` (0 unless
    set) and, if set, ``blind``; of the settings only ``controller`` has no meaning.

    Observations are dictionaries over the N intersections and 12 slots:

    - ``vehicles``, ``queue`` (N, 12): on the lanes, and of them below 0.1 m/s; 0 where nothing
      reported, or if ``filled`` what the imputer of the settings has there;
    - ``exits`` (N, 12): vehicles on exit lanes that lead to no signal, likewise;
    - ``known`` (N, 12): whether it was reported; slots that are not there count as reported;
    - ``phase`` (N,): what ran last, -1 before the first step;
    - ``red_steps`` (N, 12): decision steps since the slot last had green.

    The reward is minus the vehicles in queues at an intersection, in the mean over intersections,
    after the step. **It is the truth**, as are ``rewards`` (N,) of ``info``: they are to learn
    from, in a simulator, not to decide by. An episode ends, truncated, at the horizon; then
    ``info["result"]`` is the result as in ``run.json``.

    One simulation runs in a process at a time: several environments need several processes
    (``gymnasium.vector.AsyncVectorEnv``).
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - as in gymnasium.Env

    def __init__(
        self, settings: RunSettings, filled: bool = False, engine: EngineName = "libsumo"
    ) -> None:
        """Check the settings; nothing runs before ``reset``. Raises ``UserError``."""
        self.settings = settings
        self._scenario = find_scenario(settings.net, settings.demand)
        self.network = self._scenario.folder.network
        check_timing(settings.signals, self.network)
        self._engine: EngineName = engine
        self._imputer = make_imputer(settings.imputer, diffusion_of(settings)) if filled else None
        self._episode: Episode | None = None
        self._began = False
        self._process = os.getpid()
        self.action_space = spaces.MultiDiscrete(self.network.phase_mask.sum(axis=1))
        self.observation_space = self._space()

    def _space(self) -> spaces.Dict:
        n, steps = self.network.n, self.settings.steps
        most = self.network.phase_mask.shape[1] - 1
        count = spaces.Box(0, np.inf, (n, N_SLOTS), np.float32)
        return spaces.Dict(
            {
                "vehicles": count,
                "queue": count,
                "exits": count,
                "known": spaces.MultiBinary((n, N_SLOTS)),
                "phase": spaces.Box(-1, most, (n,), np.int64),
                "red_steps": spaces.Box(0, steps + 1, (n, N_SLOTS), np.int64),
            }
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Answer, dict[str, Any]]:
        """Begin an episode, and end the one that runs.

        ``seed`` is that of the run: demand, mask, simulator. Without one the first episode has the
        seed of the settings, and each later one a seed that is drawn from those before. Workers
        that all begin without one play the same episodes.
        """
        if seed is None and not self._began:
            seed = self.settings.seed
        if seed is not None and seed >= SEEDS:
            raise UserError("seed", seed, f"it must be below {SEEDS}")
        super().reset(seed=seed)
        self.close()
        self._began = True
        if seed is None:
            seed = int(self.np_random.integers(SEEDS))
        settings = RunSettings.model_validate({**self.settings.model_dump(), "seed": seed})
        scene = scene_of(settings, self._scenario)
        self._episode = Episode(scene, settings, self._imputer, self._engine)
        return self._answer(self._episode), self._info(self._episode)

    def step(self, action: IntArray) -> tuple[Answer, float, bool, bool, dict[str, Any]]:
        """Run a decision step with the phases (N,) of ``action``.

        Raises ``ValueError`` if one is no phase of its intersection, and ``RuntimeError`` where
        no episode runs.
        """
        episode = self._episode
        if episode is None:
            raise RuntimeError("no episode runs: call reset first")
        phases = legal_phases(action, self.network)
        if (phases < 0).any():
            n = int(np.argmin(phases))
            most = int(self.network.phase_mask[n].sum()) - 1
            raise ValueError(
                f"{np.asarray(action)[n]} is no phase of {self.network.ids[n]}: 0 to {most}"
            )
        episode.step(phases)
        answer, info = self._answer(episode), self._info(episode)
        if episode.over:
            info["result"] = episode.result().model_dump()
        return answer, float(info["rewards"].mean()), False, episode.over, info

    def close(self) -> None:
        """End the episode that runs, if one does."""
        if self._episode is not None:
            self._episode.close()
            self._episode = None

    def __del__(self) -> None:
        """End the episode of an environment that nobody has any more, but not in a fork of it."""
        if getattr(self, "_process", None) == os.getpid():
            with contextlib.suppress(Exception):
                self.close()

    def _answer(self, episode: Episode) -> Answer:
        seen = episode.observation
        return {
            "vehicles": np.nan_to_num(seen.values[:, :, VEHICLES]).astype(np.float32),
            "queue": np.nan_to_num(seen.values[:, :, QUEUE]).astype(np.float32),
            "exits": np.nan_to_num(seen.exits).astype(np.float32),
            "known": seen.mask.astype(np.int8),
            "phase": seen.phase.copy(),
            "red_steps": seen.red_steps.copy(),
        }

    def _info(self, episode: Episode) -> dict[str, Any]:
        return {"rewards": episode.truth.reward}
