"""Samples of logs, and that a controller sees its past as the samples show it."""

from dataclasses import fields

import numpy as np
import pytest

pytest.importorskip("torch", reason="the baselines need torch")

import torch
from hypothesis import given
from hypothesis import strategies as st

from tests.baselines.cases import NETWORKS, queue_logs, tiny
from tests.networks import context_for
from tsc_missing.baselines.base import Policy
from tsc_missing.baselines.controller import BaselineController
from tsc_missing.baselines.transitions import Logs, Steps
from tsc_missing.sensing.observation import Measurement, apply_mask

LENGTHS = (9, 4, 6)  # [steps] of the episodes
SETTINGS = tiny("bc", "nowhere", running_weight=0.0, reward_scale=10.0)


def logs_of(length, padded, net="tee", holes=0.0):
    episodes = [queue_logs()(NETWORKS[net], t, seed, holes) for seed, t in enumerate(LENGTHS)]
    return episodes, Logs({net: episodes}, NETWORKS, SETTINGS, length, padded)


def whole(logs):
    """All stretches, in order."""
    return list(logs.spread(10**9, 1))


@given(length=st.integers(1, 8), padded=st.booleans())
def test_stretches_lie_within_an_episode(length, padded):
    episodes, logs = logs_of(length, padded)
    found = whole(logs)
    steps = [(log, end) for log in episodes for end in range(len(log.phase))]
    steps = [(log, end) for log, end in steps if padded or end >= length - 1]
    assert len(found) == len(steps)
    for batch, (log, end) in zip(found, steps, strict=True):
        there = batch.there[0].numpy()
        assert there.sum() == min(length, end + 1)
        assert (np.diff(there.astype(int)) >= 0).all()  # the padding is before
        rows = slice(max(0, end - length + 1), end + 1)
        np.testing.assert_array_equal(batch.phase[0][there].numpy(), log.phase[rows])
        np.testing.assert_allclose(batch.values[0][there].numpy(), log.values[rows], rtol=2e-3)
        after = log.values[rows.start + 1 : end + 2, ..., 1].sum(axis=2)
        wanted = np.zeros_like(log.phase[rows], dtype=float)
        wanted[: len(after)] = -after / 10
        np.testing.assert_allclose(batch.reward[0][there].numpy(), wanted, rtol=1e-5)
        assert not batch.features[0][~there].any()
        assert (batch.phase[0][~there] == -1).all()
        assert not batch.reward[0][~there].any()
        assert not batch.known[0][~there].any()


def test_samples_are_drawn_from_all_steps_alike():
    _, logs = logs_of(2, False)
    rng = np.random.default_rng(0)
    batch = logs.sample(3000, rng)
    assert batch.samples >= 3000
    assert batch.samples % NETWORKS["tee"].n == 0
    keys = batch.features[:, 0].flatten(1)
    _, counts = keys.unique(dim=0, return_counts=True)
    assert len(counts) == sum(t - 1 for t in LENGTHS)
    assert counts.min() > 0.4 * counts.float().mean()


def test_spread_gives_about_as_many_as_wanted_from_all_episodes():
    n = NETWORKS["tee"].n
    _, logs = logs_of(1, False)
    found = list(logs.spread(8 * n, 3 * n))
    assert 5 * n <= sum(batch.samples for batch in found) <= 8 * n
    assert all(batch.samples <= 3 * n for batch in found)


def test_holes_are_filled_and_told():
    episodes, logs = logs_of(1, False, holes=0.4)
    found = whole(logs)
    known = torch.cat([batch.known[0] for batch in found]).numpy()
    np.testing.assert_array_equal(
        known, np.concatenate([log.recorded.all(axis=2) for log in episodes])
    )
    assert 0.3 < known.mean() < 0.9
    values = torch.cat([batch.values[0] for batch in found]).numpy()
    filled = values[~known].sum()
    assert np.isfinite(values).all()
    assert filled > 0
    pairs = sum(
        (log.recorded.all(axis=2)[1:] & log.recorded.all(axis=2)[:-1]).sum() for log in episodes
    )
    assert logs.rewards == pairs


class Watching(Policy):
    """Keeps what it is shown and decides at random."""

    history = 4

    def __init__(self):
        super().__init__()
        self.seen: list[Steps] = []

    def scores(self, recent, generator):
        self.seen.append(recent)
        return torch.rand((1, *recent.graph.phase_mask.shape), generator=generator)


@pytest.mark.parametrize("net", NETWORKS)
def test_a_controller_sees_its_past_as_a_log_shows_it(net):
    network = NETWORKS[net]
    (log, *_), logs = logs_of(4, True, net)
    policy = Watching()
    controller = BaselineController(policy, SETTINGS)
    for _ in range(2):  # the second run knows nothing of the first
        policy.seen.clear()
        controller.reset(context_for(network))
        for t in range(len(log.phase)):
            truth = Measurement(log.values[t].astype(float), np.zeros((network.n, 12)))
            ran = log.phase[t - 1] if t else np.full(network.n, -1)
            everything = np.ones((network.n, 12), dtype=bool)
            controller.decide(apply_mask(truth, everything, t, 15.0 * t, ran, log.red_steps[t]))
    for seen, shown in zip(policy.seen, whole(logs), strict=False):
        for field in fields(Steps):
            mine, its = getattr(seen, field.name), getattr(shown, field.name)
            if field.name in ("phase", "reward"):  # not known yet of the last step
                mine, its = mine[:, :-1], its[:, :-1]
                assert (seen.phase[:, -1] == -1).all()
                assert not seen.reward[:, -1].any()
            if field.name not in ("graph", "to_go"):
                torch.testing.assert_close(mine, its, rtol=2e-3, atol=1e-3)
