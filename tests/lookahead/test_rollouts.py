import numpy as np
import pytest

pytest.importorskip("torch", reason="Q-networks need torch")

import torch

from tests.networks import grid_network, tee_network
from tsc_missing.config import RunSettings
from tsc_missing.evaluation.closed_loop import run_closed_loop
from tsc_missing.evaluation.scenario import find_scenario
from tsc_missing.lookahead.config import LookaheadSettings
from tsc_missing.lookahead.rollouts import Lookahead, apart
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.offline.log import red_steps_of
from tsc_missing.qlearning.controller import PhaseValues, QPolicy
from tsc_missing.qlearning.networks import PhaseValue
from tsc_missing.qlearning.rewards import queue_reward

DEPTH, DISCOUNT = 3, 0.8


@pytest.fixture(scope="module")
def played(small_net, tmp_path_factory):
    """A run whose phases are all tried at every other step or so, and the same run without."""
    torch.manual_seed(1)
    q = PhaseValue(8, history=1).requires_grad_(False).eval()
    scenario = find_scenario(str(small_net), "recorded")
    network = scenario.folder.network
    run = RunSettings(net=str(small_net), horizon=450)
    plan = LookaheadSettings(
        nets=(str(small_net),), tried=0.5, depth=DEPTH, discount=DISCOUNT, reward_scale=20
    )
    scene = scenario.scene(run, np.ones((run.steps, network.n, N_SLOTS), dtype=bool))
    folders = [tmp_path_factory.mktemp(name) for name in ("tried", "plain")]
    lookahead = Lookahead(q, network, 15, plan, np.random.default_rng(0), folders[0])
    traces = [
        run_closed_loop(scene, run, QPolicy(q, "value"), folder, explore=explore)
        for folder, explore in zip(folders, (lookahead, None), strict=True)
    ]
    return network, q, lookahead.returns, traces


def test_trying_leaves_the_run_almost_as_it_was(played):
    """SUMO's saved states are not quite all of its state."""
    _, _, returns, (tried, plain) = played
    assert 5 < len(returns) < 25
    assert plain.truth.sum() > 500
    assert (tried.truth != plain.truth).mean() < 0.02
    assert tried.truth.sum() == pytest.approx(plain.truth.sum(), rel=0.01)
    assert (tried.phase != plain.phase).mean() < 0.02


def test_the_best_phase_leads_to_what_then_happens(played):
    """All follow the best values, so the run itself is what was simulated ahead."""
    network, q, returns, (trace, _) = played
    values = PhaseValues(q, network, 15)
    red = red_steps_of(network, trace.phase)
    rewards = queue_reward(trace.truth, 1.0) / 20
    checked = 0
    for step, found in returns.items():
        if step + DEPTH >= len(trace.phase):
            continue
        end = step + DEPTH
        wanted = sum(DISCOUNT**d * rewards[step + 1 + d] for d in range(DEPTH))
        last = values.of(trace.truth[end - 1 : end + 1], red[end - 1 : end + 1]).max(axis=1)
        ran = np.take_along_axis(found, trace.phase[step][:, None], axis=1)[:, 0]
        np.testing.assert_allclose(ran, wanted + DISCOUNT**DEPTH * last, rtol=1e-6)
        checked += 1
    assert checked > 5


def test_every_phase_is_tried(played):
    network, _, returns, _ = played
    for found in returns.values():
        np.testing.assert_array_equal(np.isnan(found), ~network.phase_mask)
    spread = [np.nanmax(found, axis=1) - np.nanmin(found, axis=1) for found in returns.values()]
    assert (np.concatenate(spread) > 0).mean() > 0.5


@pytest.mark.parametrize("network", [grid_network(2, 3), grid_network(3, 3), tee_network()])
def test_no_two_adjacent_try_at_a_time(network):
    groups = apart(network)
    assert (sum(groups) == 1).all()
    for group in groups:
        assert not network.adjacency[np.ix_(group, group)].any()
