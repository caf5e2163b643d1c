import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.controllers.planning import observations
from tests.networks import context_for, grid_network, tee_network
from tsc_missing.controllers.max_queue import MaxQueue
from tsc_missing.controllers.random_phases import RandomPhases, SkewedPhases
from tsc_missing.offline.policies import Unaware, make_policy
from tsc_missing.offline.seen import unaware_set

GRID = grid_network(2, 3)


@given(share=st.floats(0, 1), seed=st.integers(0, 2**31 - 1), count=st.integers(1, 60))
def test_who_is_unaware_follows_from_the_episode(share, seed, count):
    some = unaware_set(share, seed, count)
    assert some.shape == (count,)
    assert (some == unaware_set(share, seed, count)).all()
    assert (some <= unaware_set(min(1, 1.5 * share), seed, count)).all()
    if share in (0, 1):
        assert some.sum() == share * count


@pytest.mark.parametrize("neglect", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("network", [GRID, tee_network()])
def test_unaware_intersections_do_not_react_and_the_others_do(network, neglect):
    unaware = np.arange(network.n) % 2 == 0
    runs = []
    for poison in (0.0, 50.0):
        policy = Unaware(MaxQueue(), unaware, 3, neglect)
        policy.reset(context_for(network))
        phases = []
        for k, observation in enumerate(observations(network)):
            values = np.full_like(observation.values, 1.0)
            values[:, k % 12] = poison
            phases.append(policy.decide(observation.filled(values, observation.exits)))
        runs.append(np.array(phases))
    assert (runs[0][:, unaware] == runs[1][:, unaware]).all()
    assert (runs[0][:, ~unaware] != runs[1][:, ~unaware]).any()
    assert network.phase_mask[np.arange(network.n), runs[0]].all()


def test_policies_by_name():
    policy = make_policy(("max-queue", "fixed-time"), switch_at=2, epsilon=0.5)
    policy.reset(context_for(GRID))
    for observation in observations(GRID):
        filled = observation.filled(np.ones_like(observation.values), observation.exits)
        assert GRID.phase_mask[np.arange(GRID.n), policy.decide(filled)].all()


@pytest.mark.parametrize("network", [GRID, tee_network()])
def test_skewed_phases_are_there_and_not_alike_probable(network):
    (observation, *_) = observations(network)
    shares = {}
    for policy in (RandomPhases(), SkewedPhases()):
        policy.reset(context_for(network))
        drawn = np.array([policy.decide(observation) for _ in range(1000)])
        assert network.phase_mask[np.arange(network.n), drawn].all()
        times = np.stack([(drawn == p).mean(axis=0) for p in range(network.phase_mask.shape[1])])
        shares[type(policy)] = times[network.phase_mask.T]
    assert shares[RandomPhases].min() > 0.15
    assert shares[SkewedPhases].min() < 0.08
    assert shares[SkewedPhases].max() > 0.5
