import numpy as np
import pytest

from tests.networks import context_for, grid_network, tee_network
from tsc_missing.controllers.expected_queue import ExpectedQueue
from tsc_missing.sensing.observation import Measurement, apply_mask


def run(network, flows, steps=60, spread=0.0, step_red=None):
    """(T, N) phases when nothing is ever reported and the signals do as they are told."""
    controller, context = ExpectedQueue(spread), context_for(network)
    context.turning_flows[:] = flows
    controller.reset(context)
    shape = (network.n, 12)
    truth = Measurement(np.zeros((*shape, 2)), np.zeros(shape))
    phase = np.full(network.n, -1)
    red = np.where(network.free_slots, 0, 1)
    phases = []
    for step in range(steps):
        hidden = np.zeros(shape, dtype=bool)
        seen = apply_mask(truth, hidden, step, 15.0 * step, phase, red)
        phase = controller.decide(seen)
        phases.append(phase)
        green = network.phases[np.arange(network.n), phase] | network.free_slots
        red = np.where(green, 0, red + 1)
    return np.array(phases)


@pytest.mark.parametrize("network", [grid_network(2, 3), tee_network()])
def test_every_phase_with_flow_gets_its_turn_and_the_busiest_the_most(network):
    flows = np.full((network.n, 12), 60.0)
    busiest = 0
    flows[np.where(network.phases[:, busiest])] = 400.0
    phases = run(network, flows)
    for n in range(network.n):
        served = np.bincount(phases[:, n], minlength=network.phase_mask[n].sum())
        assert (served > 0).all()
        assert served.argmax() == busiest


def test_without_flow_the_first_phase_stays():
    assert (run(grid_network(2, 2), 0.0) == 0).all()


def test_errors_in_the_flows_are_those_of_the_seed():
    network = grid_network(2, 3)
    exact, wrong, again = (run(network, 200.0, spread=s) for s in (0.0, 1.0, 1.0))
    assert (wrong == again).all()
    assert (wrong != exact).any()
