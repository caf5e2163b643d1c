import numpy as np
import pytest

pytest.importorskip("torch", reason="the diffusion controller needs torch")

from tests.networks import grid_network, tee_network
from tests.offline.cases import made_up_dataset
from tsc_missing.errors import UserError
from tsc_missing.offline.dataset import EPISODES
from tsc_missing.offline.joined import read_datasets
from tsc_missing.offline.window_masks import MaskMix
from tsc_missing.offline.windows import WindowSampler


@pytest.fixture
def parts(tmp_path):
    """Two datasets with a network of the same name and another shape."""
    first = made_up_dataset(tmp_path / "a", {"it": grid_network(2, 4)}, episodes=3)
    networks = {"it": grid_network(1, 2), "tee": tee_network()}
    return first, made_up_dataset(tmp_path / "b", networks, episodes=4)


def test_episodes_are_those_of_all_with_their_own_networks(parts):
    joined = read_datasets([part.path for part in parts])
    assert len(joined.episodes) == 7
    for number in range(7):
        part, there = (parts[0], number) if number < 3 else (parts[1], number - 3)
        assert joined.networks[joined.net(number)].n == part.networks[part.net(there)].n
        np.testing.assert_array_equal(joined.load(number).values, part.load(there).values)
    with pytest.raises(IndexError):
        joined.load(7)
    about = joined.about()
    assert [part["episodes"] for part in about["joined"]] == [3, 4]
    assert joined.checksum == about["checksum"]
    assert read_datasets([part.path for part in parts[::-1]]).checksum != joined.checksum


def test_windows_come_from_all(parts):
    joined = read_datasets([part.path for part in parts])
    off = dict.fromkeys(("random", "blind", "near", "lane", "burst", "mixed"), 0.0)
    everything = MaskMix(none=1.0, **off)
    sampler = WindowSampler(joined, 5, 3, everything, seed=7)
    sampler.sample(0, 4)
    drawn = sampler.draw(400, np.random.default_rng(0))
    assert set(sampler._pool.episode[drawn.place]) == set(range(7))
    there = sampler.windows(drawn, np.random.default_rng(0)).slots
    for number, net in enumerate(map(joined.net, range(7))):
        of = sampler._pool.episode[drawn.place] == number
        wanted = joined.networks[net].slot_mask[drawn.intersection[of]]
        np.testing.assert_array_equal(there[of], wanted)


def test_one_folder_is_that_dataset(parts):
    assert read_datasets(parts[0].path).checksum == parts[0].checksum


def test_what_is_wrong_with_a_part_is_said(parts):
    with pytest.raises(UserError, match="named twice"):
        read_datasets([parts[0].path, parts[0].path / ".." / "a"])
    with pytest.raises(UserError, match="no such folder"):
        read_datasets([parts[0].path, parts[0].path / "nowhere"])
    (parts[1].path / EPISODES / "00002.parquet").unlink()
    with pytest.raises(UserError, match="missing"):
        read_datasets([part.path for part in parts]).check_episodes()
