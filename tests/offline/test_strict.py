"""Learning from logs with holes: nothing comes from under the holes, and what is hidden then."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("torch", reason="the diffusion controller needs torch")

import torch
from safetensors.torch import load_file

from tests.diffusion.cases import PUBLISHED, TINY
from tests.networks import grid_network
from tests.offline.cases import made_up_dataset, poison
from tsc_missing.config import MissingSettings
from tsc_missing.diffusion.windows import training_batch
from tsc_missing.offline.windows import WindowSampler
from tsc_missing.training.config import TrainingSettings, read_training
from tsc_missing.training.loop import Training

GRID = grid_network(3, 4)
HOLES = {
    "random": MissingSettings(pattern="random", rate=0.5),
    "kriging": MissingSettings(pattern="kriging", rate=0.25),
}
EVERYWHERE = np.arange(GRID.n)


def strict_data(path, pattern, **options):
    return made_up_dataset(path, {"grid": GRID}, missing=HOLES[pattern], unaware=0.0, **options)


@pytest.fixture(scope="module", params=HOLES)
def pattern(request):
    return request.param


@pytest.fixture(scope="module")
def dataset(pattern, tmp_path_factory):
    return strict_data(tmp_path_factory.mktemp("strict") / pattern, pattern)


def windows(dataset, pattern, count=400):
    masks = read_training(f"strict-{pattern}").masks
    return WindowSampler(dataset, 5, 3, masks, seed=1).sample(0, count)


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")  # NaN as a whole number
@pytest.mark.parametrize(
    ("model", "value"), [(TINY, 77.0), (PUBLISHED, np.nan)], ids=["difflight", "published"]
)
def test_what_is_under_the_holes_changes_no_byte_of_the_weights(
    tmp_path, pattern, dataset, model, value
):
    poisoned = strict_data(tmp_path / "d", pattern, change=lambda log: poison(log, value))
    found = []
    for name, data in (("plain", dataset), ("poisoned", poisoned)):
        settings = TrainingSettings(
            data=data.path,
            model=model,
            masks=read_training(f"strict-{pattern}").masks,
            batch=64,
            steps=3,
            warm_up=0,
        )
        found.append(load_file(Training(settings, data, tmp_path / name).run()))
    log, other = dataset.load(0), poisoned.load(0)
    assert not np.array_equal(log.values, other.values)  # the poison is in the file
    assert found[0].keys() == found[1].keys()
    for name, tensor in found[0].items():
        assert torch.equal(tensor, found[1][name]), name


def test_inputs_and_targets_are_recorded_and_apart(dataset, pattern):
    batch = training_batch(windows(dataset, pattern), TINY)
    recorded = windows(dataset, pattern).recorded
    assert not (batch.inputs.known & batch.target).any()
    assert not ((batch.inputs.known | batch.target) & ~recorded).any()
    assert batch.target[:, :5].any(), "something that was observed is hidden on purpose"
    assert (batch.inputs.known.any(dim=(1, 2)) & batch.target[:, :5].any(dim=(1, 2))).any() == (
        pattern == "random"
    )


def test_kriging_hides_whole_trajectories_of_observed_intersections(tmp_path):
    data = strict_data(tmp_path / "d", "kriging")
    dark = ~data.load(0).recorded.any(axis=(0, 2))
    assert dark.sum() == 3
    found = windows(data, "kriging")
    there = found.slots.unsqueeze(1)
    hidden = (found.hidden | ~there).all(dim=(1, 2))
    assert 0.1 < hidden.float().mean() < 0.9
    assert not (found.hidden & there)[~hidden].any()
    within = found.recorded.any(dim=(1, 2))
    assert within.all()  # no window is of an intersection that is blind in the log
    assert torch.equal(found.observable.any(dim=1), ~hidden)


def test_the_blind_intersections_of_a_log_tell_their_neighbours_nothing(tmp_path):
    """Each slot's recorded values name its intersection, so that who tells can be told."""
    cells = np.broadcast_to(EVERYWHERE[:, None, None], (GRID.n, 12, 2)).astype(np.float32)

    def named(log):
        values = np.where(log.recorded[..., None], cells, np.float32(99))
        return dataclasses.replace(log, values=values)

    data = strict_data(tmp_path / "d", "kriging", change=named)
    dark = set(np.flatnonzero(~data.load(0).recorded.any(axis=(0, 2))).tolist())
    found = windows(data, "kriging")
    told = {
        int(n)
        for values, given in (
            (found.values, found.recorded),
            (found.near_values, found.near_given),
            (found.down_values, found.down_given),
        )
        for n in values[given].unique().tolist()
    }
    assert told == set(EVERYWHERE.tolist()) - dark


def test_without_unaware_policies_blind_windows_stay_where_they_were_drawn(dataset, pattern):
    made = WindowSampler(dataset, 5, 3, read_training(f"strict-{pattern}").masks, seed=1)
    made.sample(0, 4)
    rng = np.random.default_rng(0)
    draw = made.draw(200, rng)
    moved = made._where_blind(draw, np.ones(200, dtype=bool), rng)
    np.testing.assert_array_equal(moved.intersection, draw.intersection)
