import numpy as np
import pytest

pytest.importorskip("torch", reason="the diffusion controller needs torch")

from tests.controllers.planning import save_tiny
from tests.diffusion.cases import TINY
from tests.networks import grid_network
from tests.offline.cases import made_up_log
from tsc_missing.controllers.planner import Planner
from tsc_missing.offline.fill import replay, replay_context
from tsc_missing.offline.pool import means_before
from tsc_missing.sensing.means import KNOWN


def test_what_it_remembers_is_what_was_learned_from(tmp_path):
    path = save_tiny(tmp_path / "tiny.safetensors", memory=10)
    network = grid_network(2, 3)
    log = made_up_log(network, 30, seed=0, holes=0.4)
    learned = means_before(log, 10)
    planner = Planner(path, sampling_steps=1, guided=False)
    planner.reset(replay_context(network, log.recorded, seed=0))
    for seen in replay(log.values, log.phase, log.red_steps, log.recorded):
        planner.watch(seen)
        first = seen.step - TINY.history + 1  # of the steps that it is given one by one
        there = network.slot_mask
        found = planner._history().means.numpy()[there]
        assert np.array_equal(found, learned[max(first, 0)][there])
    assert found[:, KNOWN].all()
    planner.reset(replay_context(network, log.recorded, seed=0))
    assert not planner._history().means.any()
