"""Seeds of masks: what logs and runs share, and what they never share."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from tests.networks import grid_network
from tsc_missing.config import SEEDS, MissingSettings, RunSettings
from tsc_missing.errors import UserError
from tsc_missing.evaluation.run import Options, prepare
from tsc_missing.offline.dataset import start_dataset
from tsc_missing.offline.plan import CollectSettings, draw_spec
from tsc_missing.sensing.patterns import draw_mask

GRID = grid_network(3, 4)
RUN_SEEDS = st.integers(0, SEEDS - 1)


def spec(pattern, rate, seed, number=0):
    missing = MissingSettings(pattern=pattern, rate=rate)
    return draw_spec(CollectSettings(nets=("jinan",), missing=missing, seed=seed), number)


@given(seed=RUN_SEEDS, number=st.integers(0, 1000), pattern=st.sampled_from(["random", "burst"]))
def test_no_run_can_have_the_mask_of_a_log_with_other_holes(seed, number, pattern):
    found = spec(pattern, 0.5, seed, number).mask_seed
    assert found != spec(pattern, 0.5, seed, number + 1).mask_seed
    for name in ("seed", "mask_seed"):
        with pytest.raises(ValidationError, match="less than"):
            RunSettings(**{name: found})
        RunSettings(**{name: seed})


@given(seed=RUN_SEEDS, rate=st.sampled_from([1 / 12, 2 / 12, 3 / 12]))
def test_the_blind_set_of_a_log_holds_those_of_runs_with_its_seed(seed, rate):
    logs = [spec("kriging", 0.25, seed, number) for number in range(3)]
    dark = [~draw_mask(log.missing, GRID, 2, log.mask_seed).any(axis=(0, 2)) for log in logs]
    assert (dark[0] == dark[1]).all()
    assert (dark[0] == dark[2]).all()
    run = RunSettings(mask_seed=seed, missing=MissingSettings(pattern="kriging", rate=rate))
    of_run = ~draw_mask(run.missing, GRID, 2, run.seed_of_mask).any(axis=(0, 2))
    assert of_run.sum() == round(12 * rate)
    assert not (of_run & ~dark[0]).any()


@given(seed=RUN_SEEDS)
def test_what_never_reports_in_a_log_is_the_same_in_every_episode(seed):
    missing = MissingSettings(pattern="lane", rate=0.25, lasting=True)
    settings = CollectSettings(nets=("jinan",), missing=missing, seed=seed)
    assert {draw_spec(settings, number).mask_seed for number in range(3)} == {seed}


def test_the_mask_seed_changes_the_mask_alone(small_net):
    def scene(**seeds):
        missing = MissingSettings(pattern="random", rate=0.5)
        settings = RunSettings(
            net=str(small_net), controller="max-queue", missing=missing, horizon=300, **seeds
        )
        return prepare(settings, Options()).scene

    masks = [scene(**seeds).mask for seeds in ({"seed": 3}, {"mask_seed": 3}, {"seed": 0})]
    np.testing.assert_array_equal(masks[0], masks[1])
    assert (masks[0] != masks[2]).any()
    assert RunSettings(seed=3).seed_of_mask == 3
    assert RunSettings(seed=3, mask_seed=0).seed_of_mask == 0


def test_a_collection_goes_on_with_the_networks_that_it_was_begun_with(tmp_path):
    plan, out = CollectSettings(nets=("a",), episodes=3), tmp_path / "log"
    start_dataset(out, plan, {"a/net": "1"})
    start_dataset(out, plan.model_copy(update={"seed": 5}), {"a/net": "2"})  # no episode yet
    (out / "episodes" / "00001.parquet").touch()
    start_dataset(out, plan.model_copy(update={"seed": 5, "episodes": 2}), {"a/net": "2"})
    for changes, inputs, words in (
        ({"seed": 5, "episodes": 1}, "2", "episodes: 1 .* there are 2"),
        ({"seed": 6}, "2", "begun with seed 5"),
        ({"seed": 5}, "3", "out: .* a/net has changed since"),
    ):
        with pytest.raises(UserError, match=words):
            start_dataset(out, plan.model_copy(update=changes), {"a/net": inputs})
