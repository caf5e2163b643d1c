import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.networks import grid_network, tee_network
from tests.offline.cases import made_up_log
from tsc_missing.errors import UserError
from tsc_missing.evaluation.steps import Trace
from tsc_missing.offline.log import log_of, read_log, red_steps_of, write_log
from tsc_missing.sensing.observation import N_FEATURES


def same(a, b):
    np.testing.assert_array_equal(a.values, b.values)
    np.testing.assert_array_equal(a.phase, b.phase)
    np.testing.assert_array_equal(a.red_steps, b.red_steps)
    np.testing.assert_array_equal(a.recorded, b.recorded)
    assert (a.mask is None) == (b.mask is None)


@pytest.mark.parametrize("holes", [0.0, 0.4])
def test_what_is_written_is_read(tmp_path, holes):
    log = made_up_log(tee_network(), 9, seed=1, holes=holes)
    write_log(tmp_path / "a.parquet", log, {"number": 3})
    back, about = read_log(tmp_path / "a.parquet")
    same(back, log)
    assert about == {"number": 3}
    assert [p.name for p in tmp_path.iterdir()] == ["a.parquet"]


def test_fractions_are_kept(tmp_path):
    log = made_up_log(grid_network(1, 2), 4, seed=1)
    log.values[2, 0, 3] = (1.5, 1 / 3)
    write_log(tmp_path / "a.parquet", log, {})
    np.testing.assert_array_equal(read_log(tmp_path / "a.parquet")[0].values, log.values)


def trace_of(network, mask, secret):
    trace = Trace.empty(np.ones_like(mask))
    trace.truth[:] = 3.0
    trace.truth[~mask] = secret
    trace.phase[:] = 1
    return log_of(trace, network, mask)


def test_the_truth_under_a_hole_is_not_in_the_file(tmp_path):
    network = grid_network(2, 3)
    mask = np.random.default_rng(0).random((10, 6, 12)) < 0.5
    for name, secret in (("a", 21077.0), ("b", 0.25), ("c", np.nan)):
        write_log(tmp_path / name, trace_of(network, mask, secret), {})
    contents = {name: (tmp_path / name).read_bytes() for name in "abc"}
    assert contents["a"] == contents["b"] == contents["c"]
    table = pq.read_table(tmp_path / "a")
    for feature in ("vehicles", "queue"):
        cells = table[feature].combine_chunks().flatten().to_numpy()
        assert set(cells[~mask.ravel()]) == {0}
        assert set(cells[mask.ravel()]) == {3}


def test_red_steps_count_as_the_signals_do():
    network = grid_network(1, 1)
    red = red_steps_of(network, np.array([[1], [1], [0], [2]]))
    free, served = network.free_slots[0], network.phases[0]
    assert (red[:, 0, free] == 0).all()
    assert (red[0, 0, ~free] == 1).all()
    np.testing.assert_array_equal(red[1, 0][served[1]], 0)
    np.testing.assert_array_equal(red[3, 0][served[1]], 1)
    np.testing.assert_array_equal(red[:, 0][:, served[0]].max(axis=1), [1, 2, 3, 0])
    np.testing.assert_array_equal(red[:, 0][:, served[3]].max(axis=1), [1, 2, 3, 4])


def test_no_log(tmp_path):
    path = tmp_path / "a.parquet"
    with pytest.raises(UserError, match="cannot be read"):
        read_log(path)
    write_log(path, made_up_log(grid_network(1, 1), 4, seed=0), {})
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(UserError, match=r"not an episode log|cannot be read"):
        read_log(path)
    assert N_FEATURES == 2
