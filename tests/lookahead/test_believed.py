import numpy as np
import pytest

pytest.importorskip("torch", reason="the diffusion model needs torch")

import torch

from tests.networks import grid_network
from tsc_missing.errors import UserError
from tsc_missing.lookahead.believed import Belief, read_beliefs, write_beliefs
from tsc_missing.lookahead.config import LookaheadSettings
from tsc_missing.lookahead.episode import Played
from tsc_missing.lookahead.labelled import labelled
from tsc_missing.offline.log import red_steps_of
from tsc_missing.qlearning.features import SlotTables, log_features, names_with

from tests.controllers.planning import save_tiny  # isort: skip

GRID = grid_network(2, 3)
STEPS = 12
TRIED = np.array([0, 3, 4, 11])


@pytest.fixture(scope="module")
def fill(tmp_path_factory):
    return save_tiny(tmp_path_factory.mktemp("fill") / "weights.safetensors")


def played(mask=None, poison=None):
    """Half of the intersections never report, unless a mask is given."""
    random = np.random.default_rng(0)
    shape = (STEPS, GRID.n, 12)
    if mask is None:
        mask = np.broadcast_to((np.arange(GRID.n) % 2 == 0)[:, None], shape) | ~GRID.slot_mask
    values = random.integers(0, 30, (*shape, 2)).astype(np.float32) * GRID.slot_mask[..., None]
    if poison is not None:
        values = np.where(mask[..., None], values, np.float32(poison))
    phase = random.integers(0, GRID.phase_mask.sum(axis=1), (STEPS, GRID.n))
    returns = torch.zeros(len(TRIED), *GRID.phase_mask.shape)
    return Played("x", values, phase, np.array(mask), TRIED, returns)


def beliefs(path, fill, episode, *patterns):
    plan = LookaheadSettings(nets=("x",), fill=str(fill), sampling_steps=2, patterns=patterns)
    write_beliefs(path, plan, GRID, episode, 0)
    return read_beliefs(path)


def test_what_was_seen_is_believed_and_holes_are_filled(tmp_path, fill):
    episode = played()
    own, other = beliefs(tmp_path / "b", fill, episode, "random")
    last = own.values[:, -1].numpy()
    seen = episode.mask[TRIED]
    np.testing.assert_array_equal(own.known[:, -1].numpy(), seen)
    truth = episode.values[TRIED]
    np.testing.assert_array_equal(last[seen], truth[seen])
    assert (last[~seen] != truth[~seen]).mean() > 0.5
    assert other.values.isfinite().all()
    assert (other.known != own.known).any()


def test_nothing_that_was_not_seen_is_known(tmp_path, fill):
    plain = beliefs(tmp_path / "plain", fill, played())
    poisoned = beliefs(tmp_path / "poisoned", fill, played(poison=np.nan))
    assert len(plain) == len(poisoned) == 1
    torch.testing.assert_close(plain[0].values, poisoned[0].values, rtol=0, atol=0)


def test_where_everything_was_seen_there_is_no_belief_but_of_further_masks(tmp_path, fill):
    whole = np.ones((STEPS, GRID.n, 12), dtype=bool)
    assert beliefs(tmp_path / "none", fill, played(whole)) == []
    assert len(beliefs(tmp_path / "two", fill, played(whole), "random", "lane")) == 2
    with pytest.raises(UserError, match="cannot be read"):
        read_beliefs(tmp_path / "nothing")


def test_features_of_the_truth_and_of_beliefs():
    episode = played()
    red = red_steps_of(GRID, episode.phase)
    wanted = log_features(SlotTables.of(GRID, 15), episode.values, red, 2)[TRIED]
    rows = np.maximum(TRIED[:, None] - np.arange(4, -1, -1), 0)
    known = torch.from_numpy(episode.mask[rows])
    same = Belief(torch.from_numpy(episode.values[rows]), known)
    found = labelled(episode, [same], GRID, 15, 2, certainty=True)
    truth, believed = (features.numpy() for features in found.features)
    count = len(names_with(2))
    np.testing.assert_allclose(truth[..., :count], wanted, rtol=1e-6)
    np.testing.assert_allclose(believed[..., :count], wanted, rtol=1e-6)
    assert (truth[..., count:] == [1, 0]).all()
    blind = ~episode.mask[0]
    assert (believed[:, blind][..., count:] == [0, 1]).all()
    assert (believed[:, ~blind][..., count:] == [1, 0]).all()
    assert all(counted.all() for counted in found.counted)  # the policy knew no more
    plain = labelled(episode, [], GRID, 15, 2, certainty=False)
    assert [features.shape[-1] for features in plain.features] == [count]


def test_intersections_that_are_blind_in_thought_only_are_not_learned_from():
    rows = np.maximum(TRIED[:, None] - np.arange(4, -1, -1), 0)
    mask = played().mask
    whole = played(np.ones((STEPS, GRID.n, 12), dtype=bool))
    thought = Belief(torch.from_numpy(whole.values[rows]), torch.from_numpy(mask[rows]))
    truth, believed = labelled(whole, [thought], GRID, 15, 2, certainty=True).counted
    assert truth.all()
    assert (believed.numpy() == (np.arange(GRID.n) % 2 == 0)).all()
