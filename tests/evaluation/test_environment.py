"""The Gymnasium environment: the same runs as tsc-run's, told from outside."""

import pickle
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AsyncVectorEnv

from tests.evaluation.episodes import settings
from tsc_missing.config import MissingSettings, SignalSettings
from tsc_missing.errors import UserError
from tsc_missing.evaluation.environment import SignalEnv
from tsc_missing.evaluation.run import Options, execute, prepare
from tsc_missing.simulation.engine import SimulationError

PAGE = Path(__file__).parents[2] / "docs" / "controllers.md"


@pytest.fixture
def env() -> Any:
    made = SignalEnv(settings())
    yield made
    made.close()


def longest_queue(env: SignalEnv, answer: dict[str, Any]) -> Any:
    scores = (env.network.phases * answer["queue"][:, None]).sum(axis=2)
    return np.where(env.network.phase_mask, scores, -np.inf).argmax(axis=1)


def play(env: SignalEnv, seed: int | None = None) -> tuple[list[float], dict[str, Any]]:
    answer, _ = env.reset(seed=seed)
    rewards, over = [], False
    while not over:
        answer, reward, _, over, info = env.step(longest_queue(env, answer))
        rewards.append(reward)
    return rewards, info["result"]


def test_it_is_an_environment_by_gymnasiums_own_check(env: SignalEnv) -> None:
    check_env(env, skip_render_check=True)


@pytest.mark.parametrize("net", ["jinan", "newyork"])
def test_max_queue_in_it_comes_to_what_tsc_run_has(net: str) -> None:
    signals = SignalSettings(max_red=60)
    run = settings(net=net, controller="max-queue", imputer="last", seed=3, signals=signals)
    run = run.model_copy(update={"blind": "none", "horizon": 600})
    wanted = execute(prepare(run, Options()))
    env = SignalEnv(run, filled=True)
    rewards, found = play(env)
    env.close()
    same = set(found) - {"decision_ms_median", "decision_ms_p99", "wall_s", "sim_s_per_wall_s"}
    assert {name: found[name] for name in same} == {name: getattr(wanted, name) for name in same}
    assert len(rewards) == 40
    assert min(rewards) < 0


def test_what_sensors_did_not_see_is_not_in_the_observation(env: SignalEnv) -> None:
    answer, info = env.reset(seed=1)
    shares = []
    for _ in range(20):
        answer, _, _, _, info = env.step(env.action_space.sample())
        hidden = answer["known"] == 0
        shares.append(hidden[env.network.slot_mask].mean())
        assert not answer["vehicles"][hidden].any()
        assert not answer["queue"][hidden].any()
        assert not answer["exits"][hidden].any()
    assert answer["queue"][~hidden].any()
    assert 0.4 < np.mean(shares) < 0.6
    assert np.isfinite(info["rewards"]).all()


def test_the_reward_is_minus_the_mean_queue(env: SignalEnv) -> None:
    seen = SignalEnv(settings(missing=MissingSettings()))
    answer, _ = seen.reset(seed=1)
    for _ in range(10):
        answer, reward, _, _, info = seen.step(np.zeros(seen.network.n, dtype=int))
    seen.close()
    assert reward == pytest.approx(-answer["queue"].sum() / seen.network.n)
    assert info["rewards"] == pytest.approx(-answer["queue"].sum(axis=1))


def test_episodes_differ_unless_their_seed_is_given(env: SignalEnv) -> None:
    first, second, again = play(env), play(env), play(env, seed=0)
    assert first[0] != second[0]
    assert first[0] == again[0]


def test_the_rules_of_signals_bound_the_agent() -> None:
    """Whoever always wants phase 0 lets nobody wait for longer than the maximum red."""
    run = settings(signals=SignalSettings(max_red=60), missing=MissingSettings(), horizon=600)
    env = SignalEnv(run)
    answer, _ = env.reset(seed=0)
    phases = []
    for _ in range(40):
        answer, _, _, _, _ = env.step(np.zeros(env.network.n, dtype=int))
        phases.append(answer["phase"])
    env.close()
    assert (np.array(phases) > 0).any()


@pytest.mark.parametrize(
    ("action", "words"),
    [
        (np.full(12, 4), "4 is no phase of .*: 0 to 3"),
        (np.full(12, -1), "-1 is no phase of"),
        (np.zeros(11, dtype=int), r"shape \(12,\)"),
    ],
)
def test_an_action_that_is_no_phase_is_refused(env: SignalEnv, action: Any, words: str) -> None:
    env.reset()
    with pytest.raises(ValueError, match=words):
        env.step(action)


def test_it_says_when_no_episode_runs(env: SignalEnv) -> None:
    with pytest.raises(RuntimeError, match="call reset first"):
        env.step(np.zeros(12, dtype=int))
    play(env)
    with pytest.raises(RuntimeError, match="the run is over"):
        env.step(np.zeros(12, dtype=int))


def test_two_in_one_process_are_refused_and_the_first_goes_on(env: SignalEnv) -> None:
    env.reset()
    other = SignalEnv(settings(net="hangzhou"))
    with pytest.raises(SimulationError, match="already running"):
        other.reset()
    env.step(np.zeros(12, dtype=int))
    env.close()
    other.reset()
    other.close()


def test_settings_that_are_wrong_are_told_before_anything_runs() -> None:
    with pytest.raises(UserError, match="jinn"):
        SignalEnv(settings(net="jinn"))
    with pytest.raises(UserError, match="sfmm"):
        SignalEnv(settings(imputer="sfmm"), filled=True)


def test_a_seed_that_no_run_can_have_is_refused(env: SignalEnv) -> None:
    with pytest.raises(UserError, match="4294967295 is not allowed; it must be below 2147483648"):
        env.reset(seed=2**32 - 1)
    env.reset(seed=2**31 - 1)
    env.reset()


def test_what_an_agent_writes_into_its_observation_reaches_nobody(env: SignalEnv) -> None:
    untouched = play(env, seed=5)
    answer, _ = env.reset(seed=5)
    rewards, over = [], False
    while not over:
        phases = longest_queue(env, answer)
        for array in answer.values():
            array[...] = 1
        answer, reward, _, over, info = env.step(phases)
        info["rewards"][:] = 0
        rewards.append(reward)
    assert rewards == untouched[0]


def test_seeds_of_later_episodes_differ_between_workers(env: SignalEnv) -> None:
    played = [play(env, seed)[0] for seed in (5, None, 6, None)]
    assert len({tuple(rewards) for rewards in played}) == 4


def test_one_that_nobody_has_any_more_makes_way() -> None:
    left = SignalEnv(settings())
    left.reset()
    left = SignalEnv(settings())
    left.reset()
    left.close()


def test_several_run_in_processes_of_their_own() -> None:
    several = AsyncVectorEnv([lambda: SignalEnv(settings(horizon=60))] * 2)
    answers, _ = several.reset(seed=[1, 2])
    for _ in range(4):
        answers, _, _, over, _ = several.step(several.action_space.sample())
    several.close()
    assert answers["vehicles"].shape == (2, 12, 12)
    assert over.all()


def test_filled_values_are_those_of_the_imputer(env: SignalEnv) -> None:
    filled = SignalEnv(settings(imputer="last"), filled=True)
    answer, _ = filled.reset(seed=1)
    before = answer
    for _ in range(10):
        before = answer
        answer, _, _, _, _ = filled.step(np.zeros(12, dtype=int))
    filled.close()
    hidden = answer["known"] == 0
    assert answer["vehicles"][hidden] == pytest.approx(before["vehicles"][hidden])
    assert answer["vehicles"][hidden].any()


def test_a_fresh_one_can_be_sent_to_another_process(env: SignalEnv) -> None:
    assert pickle.loads(pickle.dumps(env)).action_space == env.action_space


def test_the_example_of_the_page_runs(capsys: pytest.CaptureFixture[str]) -> None:
    example = re.search(r"```python\n(# learn.py\n.*?)```", PAGE.read_text(), re.DOTALL)
    assert example is not None
    exec(example[1].replace("horizon=900", "horizon=120"), {})
    weights = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert weights == ["0.0", "0.1", "0.3"]
