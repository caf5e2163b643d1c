"""Logs of a toy of queues, in which what a phase does is known, and tiny trainings on them."""

import numpy as np

from tests.networks import grid_network, tee_network
from tests.offline.cases import made_up_dataset
from tsc_missing.baselines.config import SETTINGS
from tsc_missing.baselines.loop import BaselineTraining
from tsc_missing.controllers.scores import phase_scores
from tsc_missing.offline.log import EpisodeLog, red_steps_of

NETWORKS = {"tee": tee_network(), "wide": grid_network(1, 3)}
SERVED = 6  # [vehicles] that a green slot lets through in a step

TINY = {
    "steps": 12,
    "batch": 16,
    "width": 8,
    "warm_up": 2,
    "log_steps": 4,
}
OWN = {
    "cql-model-based": {"reward_steps": 5},
    "decision-diffuser": {"sampling_steps": 2},
    "diffuser": {"sampling_steps": 2},
}


def tiny(name, data, **changes):
    """Settings of a training that takes no time."""
    values = {"algorithm": name, "data": data, **TINY, **OWN.get(name, {}), **changes}
    return SETTINGS[name].model_validate(values)


def random_phases(network, queues, rng):
    return rng.integers(0, network.phase_mask.sum(axis=1))


def longest_queue(network, queues, rng):
    return phase_scores(network, queues).argmax(axis=1)


def queue_logs(policy=random_phases):
    """What makes logs: queues that grow at random and shrink by ``SERVED`` where there is green."""

    def make(network, steps, seed, holes=0.0):
        rng = np.random.default_rng(seed)
        queues = rng.integers(0, 15, (network.n, 12)) * network.slot_mask
        values, phases = [], []
        for _ in range(steps):
            phase = policy(network, queues, rng)
            values.append(np.stack((queues, queues), axis=-1))
            phases.append(phase)
            green = network.phases[np.arange(network.n), phase] | network.free_slots
            arrivals = rng.integers(0, 4, queues.shape) * network.slot_mask
            queues = np.minimum(np.maximum(queues - SERVED * green, 0) + arrivals, 40)
        phase, counts = np.array(phases), np.array(values).astype(np.float32)
        mask = None
        if holes:
            mask = (rng.random((steps, network.n, 1)) >= holes) | ~network.slot_mask
            counts = np.where(mask[..., None], counts, np.float32(0))
        return EpisodeLog(counts, phase, red_steps_of(network, phase), mask)

    return make


def queue_dataset(path, policy=random_phases, networks=NETWORKS, **options):
    return made_up_dataset(path, networks, make_log=queue_logs(policy), **options)


def trained(name, dataset, folder, **changes):
    """A training that has run, and the folder's weights."""
    training = BaselineTraining(tiny(name, dataset.path, **changes), dataset, folder)
    return training, training.run()
