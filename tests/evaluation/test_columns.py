"""Columns made from NumPy's memory are the columns that pyarrow makes, to the byte in a file."""

import io

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from tsc_missing.evaluation import columns

shapes = array_shapes(min_dims=1, max_dims=3, min_side=0, max_side=20)


def file(array):
    """The bytes of a Parquet file with this column."""
    target = io.BytesIO()
    pq.write_table(pa.Table.from_arrays([array], ["column"]), target)
    return target.getvalue()


def assert_same(made, expected):
    made.validate(full=True)
    assert made.equals(expected)
    assert made.null_count == expected.null_count
    assert file(made) == file(expected)


@given(arrays(st.sampled_from([np.float64, np.float32]), shapes))
def test_measured_values_are_null_where_nan(values):
    flat = values.ravel()
    assert_same(columns.measured(values), pa.array(flat, mask=np.isnan(flat)))


@pytest.mark.parametrize("kind", [np.int8, np.int32, np.int64, np.float32, np.float64])
def test_numbers_keep_their_type_and_order(kind):
    values = np.arange(60, dtype=kind).reshape(5, 3, 4)
    assert_same(columns.numbers(values), pa.array(values.ravel()))
    assert_same(columns.numbers(values[:, 1]), pa.array(values[:, 1].ravel()))
    assert_same(columns.numbers(values.T), pa.array(values.T.ravel()))


@given(arrays(np.bool_, shapes))
def test_flags(values):
    assert_same(columns.flags(values), pa.array(values.ravel()))


@given(st.lists(st.text()))
def test_texts_and_recurring_names(values):
    expected = pa.array(values, pa.string())
    assert_same(columns.texts(values), expected)
    assert_same(columns.names(values), expected.dictionary_encode())


@given(st.lists(st.integers(0, 2)))
def test_coded_texts(codes):
    array, meaning = np.array(codes, dtype=np.int8), ["waiting", "running", "finished"]
    expected = pa.DictionaryArray.from_arrays(pa.array(array), pa.array(meaning))
    assert_same(columns.coded(array, meaning), expected)


def test_lists():
    values = np.where(np.arange(24) % 5 == 0, np.nan, np.arange(24.0)).reshape(2, 12)
    expected = pa.array(
        [[None if np.isnan(v) else v for v in row] for row in values], pa.list_(pa.float64(), 12)
    )
    assert_same(columns.lists(columns.measured(values), 12), expected)
