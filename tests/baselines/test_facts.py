"""What is true of each algorithm in particular."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch", reason="the baselines need torch")

import torch

from tests.baselines.cases import longest_queue, queue_dataset, queue_logs, tiny, trained
from tests.networks import grid_network
from tsc_missing.baselines.bc import BC
from tsc_missing.baselines.loop import BaselineTraining
from tsc_missing.baselines.td3_bc import TD3BC
from tsc_missing.baselines.transitions import Logs
from tsc_missing.controllers.scores import phase_scores
from tsc_missing.errors import UserError

GRID = {"grid": grid_network(1, 2)}
LONGER = {"steps": 300, "batch": 64, "width": 16, "log_steps": 300, "learning_rate": 3e-3}


@pytest.fixture(scope="module")
def random_data(tmp_path_factory):
    """Logs of phases at random."""
    path = tmp_path_factory.mktemp("random") / "d"
    return queue_dataset(path, networks=GRID, episodes=6, steps=60)


def held_out(training):
    """All steps of the held-out episodes: scores (B, N, P) and the steps."""
    (batch,) = training._held_out.spread(10**6, 10**6)
    with torch.no_grad():
        return training.learner.policy.network(batch.features[:, 0], batch.graph), batch


def agreement(training):
    """The share of decisions that are max-queue's."""
    scores, batch = held_out(training)
    queues = batch.values[:, 0, ..., 1].double().numpy()
    best = [phase_scores(GRID["grid"], q).argmax(axis=1) for q in queues]
    return float((scores.argmax(dim=-1).numpy() == np.array(best)).mean())


def test_bc_recovers_a_policy(tmp_path):
    data = queue_dataset(tmp_path / "d", longest_queue, GRID, episodes=6, steps=60)
    training, _ = trained("bc", data, tmp_path / "t", **LONGER)
    assert training.held_out()["accuracy"] > 0.85


def test_bc_of_random_phases_knows_nothing(random_data, tmp_path):
    training, _ = trained("bc", random_data, tmp_path / "t", **{**LONGER, "steps": 60})
    assert training.held_out()["accuracy"] < 0.45


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("cql", {"alpha": 0.02, "target_rate": 0.02}),
        ("td3-bc", {"alpha": 100.0, "target_rate": 0.02, "policy_delay": 1}),
        ("cql-model-based", {"alpha": 0.02, "target_rate": 0.02, "reward_steps": 30}),
    ],
)
def test_values_do_better_than_the_log(random_data, tmp_path, name, options):
    training, _ = trained(name, random_data, tmp_path / "t", **{**LONGER, **options})
    assert agreement(training) > 0.6


@pytest.mark.parametrize(("alpha", "below"), [(1.0, True), (0.0, False)])
def test_cql_puts_phases_that_the_log_does_not_have_below(tmp_path, alpha, below):
    def never_last(network, queues, rng):
        return rng.integers(0, network.phase_mask.sum(axis=1) - 1)

    data = queue_dataset(tmp_path / "d", never_last, GRID, episodes=6, steps=60)
    training, _ = trained("cql", data, tmp_path / "t", **LONGER, alpha=alpha, target_rate=0.05)
    values, _ = held_out(training)
    share = (values[..., -1] < values[..., :-1].min(dim=-1).values).float().mean().item()
    assert (share > 0.95) == below


def test_td3_bc_without_values_is_bc(random_data):
    common = {"width": 16}
    torch.manual_seed(0)
    settings = tiny("td3-bc", random_data.path, alpha=0.0, policy_delay=1, **common)
    td3, bc = TD3BC(settings), BC(tiny("bc", random_data.path, **common))
    bc.policy.load_state_dict(td3.policy.state_dict())
    logs = [queue_logs()(GRID["grid"], 40, 0)]
    pairs = Logs({"grid": logs}, GRID, settings, 2, False)
    rng, generator = np.random.default_rng(0), torch.Generator()
    for step in range(5):
        batch = pairs.sample(32, rng)
        td3.update(batch, step, generator)
        first = replace(batch, features=batch.features[:, :1], phase=batch.phase[:, :1])
        bc.update(first, step, generator)
    for name, weight in bc.policy.state_dict().items():
        torch.testing.assert_close(weight, td3.policy.state_dict()[name])


def test_td3_bc_updates_its_actor_at_every_second_step(random_data, tmp_path):
    training = BaselineTraining(tiny("td3-bc", random_data.path), random_data, tmp_path / "t")
    changed = []
    for _ in range(4):
        before = [weight.clone() for weight in training.learner.policy.parameters()]
        training.train_step()
        after = training.learner.policy.parameters()
        changed.append(any(not torch.equal(b, a) for b, a in zip(before, after, strict=True)))
    assert changed == [True, False, True, False]


def test_the_reward_model_knows_rewards_that_it_has_not_seen(tmp_path):
    data = queue_dataset(tmp_path / "d", networks=GRID, episodes=6, steps=60, holes=0.3)
    options = {**LONGER, "steps": 330, "reward_steps": 300}
    training, _ = trained("cql-model-based", data, tmp_path / "t", **options)
    (batch,) = training._held_out.spread(10**6, 10**6)
    known = batch.known.all(dim=1)
    spread = batch.reward[:, 0][known].std().item()
    assert training.held_out()["reward_error"] < 0.4 * spread
    reward = training.learner.reward(batch)
    assert torch.equal(reward[batch.known[:, 1]], batch.reward[:, 0][batch.known[:, 1]])
    hidden = ~batch.known[:, 1]
    assert not torch.equal(reward[hidden], batch.reward[:, 0][hidden])


def test_no_reward_was_ever_observed(tmp_path):
    data = queue_dataset(tmp_path / "d", networks=GRID, episodes=2, steps=20, holes=1.0)
    with pytest.raises(UserError, match="no reward to learn from"):
        trained("cql-model-based", data, tmp_path / "t")
