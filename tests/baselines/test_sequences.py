"""What is true of the methods that look at, or plan, several steps."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch", reason="the baselines need torch")

import torch
from pydantic import ValidationError

from tests.baselines.cases import longest_queue, queue_logs, tiny
from tests.controllers.planning import observations, reordered, taken
from tests.networks import context_for, grid_network, tee_network
from tests.offline.cases import made_up_dataset
from tsc_missing.baselines.controller import BaselineController
from tsc_missing.baselines.loop import BaselineTraining
from tsc_missing.baselines.plans import STATES
from tsc_missing.baselines.registry import make_learner
from tsc_missing.baselines.transitions import Logs
from tsc_missing.controllers.scores import phase_scores
from tsc_missing.offline.log import EpisodeLog, red_steps_of

GRID = {"grid": grid_network(1, 2)}
PLANNERS = ("diffuser", "decision-diffuser")
ALL = ("decision-transformer", *PLANNERS)
LONGER = {"steps": 200, "batch": 64, "width": 16, "log_steps": 200, "learning_rate": 5e-3}


def shortest_queue(network, queues, rng):
    return np.where(network.phase_mask, -phase_scores(network, queues), -np.inf).argmax(axis=1)


@pytest.fixture(scope="module")
def mixed(tmp_path_factory):
    """Logs of a good policy and of a bad one, in turn."""

    def make(network, steps, seed, holes):
        policy = (longest_queue, shortest_queue)[seed % 2]
        return queue_logs(policy)(network, steps, seed, holes)

    path = tmp_path_factory.mktemp("mixed") / "d"
    return made_up_dataset(path, GRID, episodes=8, steps=60, make_log=make)


@pytest.fixture(scope="module")
def learners(mixed, tmp_path_factory):
    """Of each method, trained on them; and a batch of what was held out."""
    found = {}
    for name in ALL:
        folder = tmp_path_factory.mktemp(name) / "t"
        training = BaselineTraining(tiny(name, mixed.path, **LONGER), mixed, folder)
        training.run()
        found[name] = training.learner.eval(), next(training._held_out.spread(10**6, 512))
    return found


def generator():
    return torch.Generator().manual_seed(0)


def stretches(learner, settings, steps=20, net=GRID["grid"]):
    """All stretches of one log."""
    log = queue_logs()(net, steps, 0)
    logs = Logs(
        {"it": [log]}, {"it": net}, settings, learner.length, learner.padded, learner.ahead,
        learner.discount,
    )  # fmt: skip
    return log, next(logs.spread(10**6, 10**6))


def untrained(name, **changes):
    torch.manual_seed(0)
    settings = tiny(name, "nowhere", **changes)
    return make_learner(settings).eval(), settings


@pytest.mark.parametrize(("discount", "ahead"), [(1.0, 0), (0.9, 3), (0.0, 1)])
def test_samples_tell_what_was_earned_and_what_is_to_go(discount, ahead):
    settings = tiny("bc", "nowhere")
    episodes = [queue_logs()(GRID["grid"], steps, steps) for steps in (12, 7)]
    logs = Logs({"grid": episodes}, GRID, settings, 4, True, ahead, discount)
    found = list(logs.spread(10**6, 1))
    wanted = [(log, end) for log in episodes for end in range(ahead, len(log.phase))]
    assert len(found) == len(wanted)
    assert logs.steps == 12
    assert logs.returns(whole=True).shape == (2 * 2,)
    for batch, (log, end) in zip(found, wanted, strict=True):
        rewards = -log.values[1:, ..., 1].sum(axis=2) / settings.reward_scale
        for at, t in zip(range(-1, -5, -1), range(end, -1, -1), strict=False):
            assert batch.position[0, at] == t
            np.testing.assert_allclose(batch.earned[0, at], rewards[:t].sum(axis=0), rtol=1e-4)
            rest = rewards[min(t, len(rewards) - 1) :]  # the last one's reward is not known
            weights = discount ** np.arange(len(rest))
            mean = (rest * weights[:, None]).sum(axis=0) / weights.sum()
            np.testing.assert_allclose(batch.to_go[0, at], mean, rtol=1e-4)


@pytest.mark.parametrize("part", ["features", "phase", "to_go", "earned"])
def test_decision_transformer_does_not_see_what_comes_later(part):
    learner, settings = untrained("decision-transformer")
    _, batch = stretches(learner, settings)
    at = 5
    changed = getattr(batch, part).clone()
    if part == "phase":  # that of the step itself is not known yet when it is chosen
        changed[:, at:] = (changed[:, at:] + 1) % 4
    else:
        changed[:, at + 1 :] += 1
    other = replace(batch, **{part: changed})
    policy = learner.policy
    if part == "earned":
        before, after = (policy.logits(b, policy.asked_to_go(b)) for b in (batch, other))
    else:
        before, after = (policy.logits(b, b.to_go) for b in (batch, other))
    torch.testing.assert_close(before[:, : at + 1], after[:, : at + 1], rtol=0, atol=0)
    assert not torch.allclose(before[:, at + 1 :], after[:, at + 1 :])


def test_decision_transformer_does_not_see_padding():
    learner, settings = untrained("decision-transformer")
    _, batch = stretches(learner, settings)
    padding = ~batch.there
    assert padding.any()
    far = batch.features + 9 * padding[:, :, None, None, None]
    other = replace(batch, features=far, phase=torch.where(padding[..., None], 1, batch.phase))
    mine, its = (learner.policy.logits(b, b.to_go)[batch.there] for b in (batch, other))
    torch.testing.assert_close(mine, its, rtol=0, atol=0)


def test_a_run_that_earns_as_its_log_asks_for_what_the_log_got():
    learner, settings = untrained("decision-transformer")
    log, batch = stretches(learner, settings)
    policy = learner.policy
    policy.last.fill_(len(log.phase) - 1)
    for n in range(2):
        policy.returns.asked.copy_(batch.to_go[0, -1, n])  # of the whole log
        asked = policy.asked_to_go(batch)[:-1, -1, n]
        torch.testing.assert_close(asked, batch.to_go[:-1, -1, n], rtol=1e-3, atol=1e-4)
    policy.returns.asked.zero_()
    assert not policy.asked_to_go(batch).any()  # behind: there is no better reward than 0


def lucky_log(seed):
    """Four steps; the first phase tells whether the queues after it will be short."""
    network, rng = GRID["grid"], np.random.default_rng(seed)
    lucky = rng.integers(0, 2, network.n)
    queues = rng.integers(0, 20, (4, network.n, 12)) * network.slot_mask
    queues[1:] = queues[1:] // 10 + 15 * (1 - lucky)[:, None] * network.slot_mask
    phase = rng.integers(0, 4, (4, network.n))
    phase[0] = 2 * lucky
    values = np.stack((queues, queues), axis=-1).astype(np.float32)
    return EpisodeLog(values, phase, red_steps_of(network, phase), None)


def test_who_asks_decision_transformer_for_more_gets_other_phases():
    learner, settings = untrained("decision-transformer", width=16, learning_rate=3e-3)
    logs = Logs({"grid": [lucky_log(k) for k in range(40)]}, GRID, settings, 8, True)
    learner.prepare(logs)
    rng = np.random.default_rng(0)
    for step in range(150):
        learner.update(logs.sample(64, rng), step, generator())
    (batch,) = Logs({"grid": [lucky_log(99)]}, GRID, settings, 8, True).spread()
    start = batch.position[:, -1] == 0
    returns = logs.returns(whole=True)
    for asked, phase in ((returns.min(), 0), (returns.max(), 2)):
        learner.policy.returns.asked.copy_(asked)
        assert (learner.policy.scores(batch, generator())[start].argmax(dim=-1) == phase).all()


@pytest.mark.parametrize("name", PLANNERS)
def test_plans_keep_what_is_known_and_are_made_by_nothing_else(name):
    learner, settings = untrained(name)
    _, batch = stretches(learner, settings, net=tee_network())
    policy, past = learner.policy, learner.past(batch)
    plan = policy.plan(past, generator())
    x0 = policy.trajectories(batch).transpose(1, 2)
    assert torch.equal(plan[:, policy.known], x0[:, policy.known])
    assert not torch.allclose(plan[:, ~policy.known], x0[:, ~policy.known])
    later = replace(
        past,
        phase=torch.cat((past.phase[:, :-1], 0 * past.phase[:, -1:]), dim=1),
        to_go=past.to_go * torch.nan,
    )
    assert torch.equal(policy.plan(later, generator()), plan)
    assert not torch.equal(policy.plan(past, torch.Generator().manual_seed(1)), plan)


def test_guidance_raises_the_return_that_diffuser_expects(learners):
    learner, batch = learners["diffuser"]
    policy, past = learner.policy, learner.past(batch)
    present = policy.value.present(learner.features_now(batch))
    there = torch.zeros((len(present), 1, learner.length))
    there[:, :, : policy.history] = 1
    expected = []
    for guidance in (0.0, 1.0, 4.0):
        policy.guidance = guidance
        plan = policy.plan(past, generator())
        expected.append(policy.value(plan, torch.tensor([1]), there, present).mean().item())
    policy.guidance = learner.settings.guidance
    assert expected[0] < expected[1] < expected[2]


def test_decision_diffuser_plans_shorter_queues_for_a_higher_return(learners):
    learner, batch = learners["decision-diffuser"]
    policy, past = learner.policy, learner.past(batch)
    queues = []
    for quantile in (0.02, 0.98):
        policy.returns.asked.copy_(batch.to_go.quantile(quantile))
        plan = policy.plan(past, generator())[:, :STATES, policy.history :]
        queues.append(plan.unflatten(1, (12, 2))[:, :, 1].mean().item())
    assert queues[1] < 0.9 * queues[0]
    assert learner.held_out(batch, generator())["inverse_accuracy"] > 0.6


@pytest.mark.parametrize("name", ALL)
def test_permuting_intersections_permutes_the_decisions(learners, name):
    learner, _ = learners[name]
    network = tee_network()
    order = np.random.default_rng(5).permutation(network.n)
    seen = [replace(o, values=np.nan_to_num(o.values)) for o in observations(network)]
    found = []
    for at in (np.arange(network.n), order):
        controller = BaselineController(learner.policy, tiny(name, "nowhere"))
        controller.reset(context_for(reordered(network, at)))
        found.append(np.array([controller.decide(taken(o, at)) for o in seen]))
    np.testing.assert_array_equal(found[0][:, order], found[1])
    assert len(np.unique(found[0])) > 1


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("decision-transformer", {"heads": 3}),
        ("diffuser", {"horizon": 2}),
        ("diffuser", {"width": 12}),
        ("decision-diffuser", {"sampling_steps": 101}),
    ],
)
def test_settings_that_do_not_fit(name, changes):
    with pytest.raises(ValidationError):
        tiny(name, "nowhere", **changes)
