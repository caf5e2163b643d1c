"""The PettingZoo environment: the same episodes as the Gymnasium one's."""

from typing import Any

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test

from tests.evaluation.episodes import settings
from tsc_missing.evaluation.environment import SignalEnv
from tsc_missing.evaluation.parallel_environment import SignalParallelEnv


@pytest.fixture
def env() -> Any:
    made = SignalParallelEnv(settings())
    yield made
    made.close()


def test_it_is_an_environment_by_pettingzoos_own_check(env: SignalParallelEnv) -> None:
    parallel_api_test(env, num_cycles=50)


@pytest.mark.parametrize("net", ["jinan", "newyork"])
def test_agents_play_what_one_agent_of_all_plays(net: str) -> None:
    actions = np.random.default_rng(0)
    one, many = SignalEnv(settings(net=net)), SignalParallelEnv(settings(net=net))
    plan = [actions.integers(one.action_space.nvec) for _ in range(20)]
    seen, _ = one.reset(seed=5)
    wanted = [(seen, one.step(phases)) for phases in plan]
    one.close()
    each, infos = many.reset(seed=5)
    assert list(each) == list(infos) == many.agents == list(many.network.ids)
    for (_, (after, reward, _, over, info)), phases in zip(wanted, plan, strict=True):
        found, rewards, ended, cut, infos = many.step(
            dict(zip(many.possible_agents, phases, strict=True))
        )
        for n, agent in enumerate(many.possible_agents):
            assert many.observation_space(agent).contains(found[agent])
            assert all((found[agent][name] == after[name][n]).all() for name in after)
            assert rewards[agent] == info["rewards"][n]
        assert np.mean(list(rewards.values())) == pytest.approx(reward)
        assert set(ended.values()) == {False}
        assert set(cut.values()) == {over}
    assert not many.agents
    with pytest.raises(RuntimeError, match="no episode runs: call reset first"):
        many.step({})
    last = {infos[agent]["result"]["att_all"] for agent in many.possible_agents}
    assert last == {info["result"]["att_all"]}


def test_every_agent_must_act(env: SignalParallelEnv) -> None:
    with pytest.raises(RuntimeError, match="no episode runs: call reset first"):
        env.step({})
    env.reset(seed=0)
    first, second, *others = env.agents
    with pytest.raises(ValueError, match=f"^no action of {first}, {second}$"):
        env.step(dict.fromkeys(others, 0))
    with pytest.raises(ValueError, match=f"^9 is no phase of {first}: 0 to 3$"):
        env.step({**dict.fromkeys(env.agents, 0), first: 9})
