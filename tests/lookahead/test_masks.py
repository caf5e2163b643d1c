import numpy as np

from tests.networks import grid_network
from tsc_missing.lookahead.config import LookaheadSettings
from tsc_missing.lookahead.masks import besides, played_with

GRID = grid_network(3, 4)


def plan(**given):
    return LookaheadSettings(nets=("x",), **given)


def test_what_is_lost_in_episodes_comes_in_turn():
    settings = plan(lost=("kriging", "none", "random"))
    blind, seen, random = (played_with(settings, GRID, 40, number) for number in range(3))
    assert seen.all()
    reports = blind.all(axis=(0, 2))
    assert (reports == blind.any(axis=(0, 2))).all()
    assert 1 <= (~reports).sum() <= 5
    assert random.any(axis=(0, 2)).all()
    assert not random.all()
    assert (played_with(settings, GRID, 40, 3) != blind).any()
    assert (played_with(settings, GRID, 40, 0) == blind).all()


def test_further_masks_of_an_episode_are_its_own():
    settings = plan(patterns=("random", "random", "lane"))
    masks = list(besides(settings, GRID, 40, 0))
    assert len(masks) == 3
    assert (masks[0] != masks[1]).any()
    assert len(np.unique(masks[2].any(axis=(0, 1)))) == 1
    assert (next(besides(settings, GRID, 40, 1)) != masks[0]).any()


def test_where_a_network_has_no_room_nothing_is_lost():
    single = grid_network(1, 1)
    crowded = plan(lost=("kriging",), patterns=("kriging", "random"))
    assert played_with(crowded, single, 10, 0).shape == (10, 1, 12)
    assert 1 <= len(list(besides(crowded, single, 10, 0))) <= 2
