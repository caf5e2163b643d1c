import numpy as np
import pytest

from tests.networks import grid_network, tee_network
from tests.offline.cases import made_up_log
from tsc_missing.imputation.last_value import LastValue
from tsc_missing.imputation.store_and_forward import StoreAndForward
from tsc_missing.offline.fill import fill_log

NETWORKS = {"grid": grid_network(2, 3), "tee": tee_network()}


@pytest.mark.parametrize("network", NETWORKS.values(), ids=NETWORKS)
@pytest.mark.parametrize("make", [StoreAndForward, LastValue])
def test_what_was_recorded_stays_and_nothing_comes_from_later(network, make):
    log = made_up_log(network, 12, 0, holes=0.5)
    filled = fill_log(log, network, make())
    np.testing.assert_array_equal(filled.values[log.mask], log.values[log.mask])
    assert np.isfinite(filled.values).all()
    assert filled.values[~log.mask].any()
    assert not filled.values[:, ~network.slot_mask].any()
    later = log.values.copy()
    later[7:] *= 3
    other = fill_log(type(log)(later, log.phase, log.red_steps, log.mask), network, make())
    np.testing.assert_array_equal(filled.values[:7], other.values[:7])
    assert (filled.values[7:] != other.values[7:]).any()


def test_a_complete_log_is_left_as_it_is():
    log = made_up_log(NETWORKS["tee"], 5, 0)
    assert fill_log(log, NETWORKS["tee"], StoreAndForward()) is log


def test_a_held_value():
    network = NETWORKS["grid"]
    log = made_up_log(network, 6, 0, holes=0.5)
    log.mask[0] = True
    log.mask[1:3, 0, 4] = False
    filled = fill_log(log, network, LastValue())
    np.testing.assert_array_equal(filled.values[1:3, 0, 4], [log.values[0, 0, 4]] * 2)
