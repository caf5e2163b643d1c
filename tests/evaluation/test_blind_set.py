"""Strict weights at intersections that their log did observe."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="the diffusion controller needs torch")

from tests.diffusion.cases import model
from tsc_missing.config import DiffusionSettings, MissingSettings, RunSettings
from tsc_missing.diffusion.weights import save_weights
from tsc_missing.evaluation.blind_set import observed_in_the_log
from tsc_missing.evaluation.run import Options, prepare
from tsc_missing.offline.plan import CollectSettings

KRIGING = MissingSettings(pattern="kriging", rate=0.34)  # 2 of 6


@pytest.fixture
def found(small_net, tmp_path):
    def of(log: MissingSettings, missing: MissingSettings, weights=None, net=None, **run):
        path = tmp_path / "weights.safetensors"
        collected = CollectSettings(nets=(net or str(small_net),), missing=log, seed=5)
        save_weights(model(), path, {"data": {"settings": collected.model_dump(mode="json")}})
        settings = RunSettings(
            net=str(small_net),
            missing=missing,
            diffusion=DiffusionSettings(weights=weights or str(path), scoring="queue"),
            horizon=300,
            **run,
        )
        prepared = prepare(settings, Options())
        mask = prepared.scene.mask
        dark = np.flatnonzero(~mask.any(axis=(0, 2)))
        return observed_in_the_log(prepared), {prepared.scene.network.ids[n] for n in dark}

    return of


def test_the_blind_set_of_the_log_and_its_parts_are_as_they_should_be(found):
    for rate in (0.17, 0.34):
        missing = MissingSettings(pattern="kriging", rate=rate)
        assert found(KRIGING, missing, mask_seed=5)[0] is None
        assert found(KRIGING, missing, seed=5)[0] is None


def test_others_are_named_with_the_seed_of_the_log(found):
    _, own = found(KRIGING, KRIGING, mask_seed=5)
    told = [found(KRIGING, KRIGING, mask_seed=seed) for seed in range(5)]
    assert any(found is not None for found, _ in told)
    for answer, dark in told:
        assert answer == ((tuple(sorted(dark - own)), 5) if dark - own else None)


def test_other_weights_and_masks_are_not_looked_at(found):
    random = MissingSettings(pattern="random", rate=0.5)
    assert found(random, KRIGING)[0] is None
    assert found(KRIGING, MissingSettings())[0] is None
    assert found(KRIGING, KRIGING, net="jinan")[0] is None
    assert found(KRIGING, KRIGING, weights="universal")[0] is None
    assert found(KRIGING, KRIGING, controller="max-queue")[0] is None
