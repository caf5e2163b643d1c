"""The closed loop as a PettingZoo environment: every intersection is an agent."""

from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

from tsc_missing.config import RunSettings
from tsc_missing.evaluation.environment import Answer, SignalEnv
from tsc_missing.simulation.engine import EngineName

Each = dict[str, Any]


class SignalParallelEnv(ParallelEnv[str, Answer, int]):  # type: ignore[misc]  # untyped there
    """``SignalEnv`` with an agent for each of the N intersections, named by its id.

    All agents stay until the horizon, where all are truncated. An agent observes its own row of
    ``SignalEnv``'s arrays, as ``vehicles`` (12,) and ``phase`` (1,), and acts by a phase of its
    intersection. Its reward is minus the vehicles in queues there after the step, **the truth**.
    At the end of an episode ``infos`` holds the same result of the whole run for every agent.

    Who hears of whom is the learner's affair: ``network.neighbours`` says which slots feed which.
    """

    metadata: dict[str, Any] = {"render_modes": [], "name": "tsc_missing"}  # noqa: RUF012 - as there

    def __init__(
        self, settings: RunSettings, filled: bool = False, engine: EngineName = "libsumo"
    ) -> None:
        """Check the settings, as ``SignalEnv`` does; nothing runs before ``reset``."""
        self._env = SignalEnv(settings, filled, engine)
        self.network = self._env.network
        self.possible_agents = list(self.network.ids)
        self.agents: list[str] = []
        counts = self.network.phase_mask.sum(axis=1).tolist()
        self._actions = {
            agent: spaces.Discrete(count)
            for agent, count in zip(self.possible_agents, counts, strict=True)
        }
        whole = self._env.observation_space
        assert isinstance(whole, spaces.Dict)
        self._observations = spaces.Dict({name: _row(space) for name, space in whole.items()})

    def observation_space(self, agent: str) -> spaces.Dict:
        """The same for all agents."""
        return self._observations

    def action_space(self, agent: str) -> spaces.Discrete:
        """The phases of an agent's intersection."""
        return self._actions[agent]

    def reset(self, seed: int | None = None, options: Each | None = None) -> tuple[Each, Each]:
        """Begin an episode, with a seed as in ``SignalEnv.reset``."""
        answer, _ = self._env.reset(seed=seed, options=options)
        self.agents = list(self.possible_agents)
        return self._rows(answer), {agent: {} for agent in self.agents}

    def step(self, actions: dict[str, int]) -> tuple[Each, Each, Each, Each, Each]:
        """Run a decision step with a phase of every intersection.

        Raises ``ValueError`` if an agent has none, or one that is no phase of its intersection,
        and ``RuntimeError`` where no episode runs.
        """
        if not self.agents:
            raise RuntimeError("no episode runs: call reset first")
        if missing := [agent for agent in self.agents if agent not in actions]:
            raise ValueError(f"no action of {', '.join(missing)}")
        phases = np.array([actions[agent] for agent in self.agents])
        answer, _, _, over, info = self._env.step(phases)
        rewards = dict(zip(self.agents, info.pop("rewards").tolist(), strict=True))
        ended, cut = dict.fromkeys(self.agents, False), dict.fromkeys(self.agents, over)
        infos = {agent: dict(info) for agent in self.agents}
        if over:
            self.agents = []
        return self._rows(answer), rewards, ended, cut, infos

    def close(self) -> None:
        """End the episode that runs, if one does."""
        self._env.close()

    def _rows(self, answer: Answer) -> Each:
        return {
            agent: {name: np.atleast_1d(values[n]) for name, values in answer.items()}
            for n, agent in enumerate(self.possible_agents)
        }


def _row(space: spaces.Space[Any]) -> spaces.Space[Any]:
    """What one intersection has of a space of N."""
    if isinstance(space, spaces.MultiBinary):
        return spaces.MultiBinary(space.shape[1:])
    assert isinstance(space, spaces.Box)
    low, high = np.atleast_1d(space.low[0], space.high[0])
    return spaces.Box(low, high, dtype=low.dtype.type)
