import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tsc_missing.sensing.means import GREEN, KNOWN, RunningMeans

READINGS = st.lists(
    st.one_of(st.none(), st.floats(0, 50)), min_size=1, max_size=30
)  # of one slot, none where it does not report


def means_of(readings, steps):
    means = RunningMeans((1,), steps)
    for reading in readings:
        value = np.nan if reading is None else reading
        known = np.array([reading is not None])
        means.take(np.array([[value, value]]), known, np.array([reading is None]))
    return means.table()[0]


@given(READINGS)
def test_few_readings_count_alike(readings):
    found = [reading for reading in readings if reading is not None]
    table = means_of(readings, steps=30)
    np.testing.assert_allclose(table[:GREEN], np.mean(found) if found else 0, atol=1e-4)
    assert table[KNOWN] == bool(found)
    np.testing.assert_allclose(table[GREEN], 1 - len(found) / len(readings), atol=1e-6)


@given(READINGS, st.integers(1, 10))
def test_means_lie_between_the_readings_and_forget(readings, steps):
    found = [reading for reading in readings if reading is not None]
    table = means_of(readings, steps)
    if found:
        assert min(found) - 1e-4 <= table[0] <= max(found) + 1e-4
    later = means_of([*readings, *[7.0] * 20 * steps], steps)
    np.testing.assert_allclose(later[:GREEN], 7, atol=1e-4)


def test_steps_without_a_reading_change_nothing_but_green():
    table = means_of([3.0, 5.0], 10)
    after = means_of([3.0, 5.0, None, None], 10)
    assert np.array_equal(table[:GREEN], after[:GREEN])
    assert after[GREEN] == 0.5
