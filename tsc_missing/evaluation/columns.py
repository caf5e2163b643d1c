"""Columns for Parquet files, made from the memory of NumPy arrays.

``pyarrow.array`` would do the same, but it imports pandas wherever that is installed.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from tsc_missing.network.model import BoolArray, IntArray

Array = Any  # pyarrow comes without types


def numbers(values: npt.NDArray[Any], null: BoolArray | None = None) -> Array:
    """A column of numbers, of the array's type and in its order; null where ``null`` is true."""
    flat = np.ascontiguousarray(values).reshape(-1)
    valid = None if null is None else _bits(~null)
    return pa.Array.from_buffers(
        pa.from_numpy_dtype(flat.dtype), flat.size, [valid, pa.py_buffer(flat)]
    )


def measured(values: npt.NDArray[np.floating[Any]]) -> Array:
    """A column of numbers, null where they are NaN."""
    return numbers(values, np.isnan(values))


def flags(values: BoolArray) -> Array:
    """A column of truth values."""
    return pa.Array.from_buffers(pa.bool_(), values.size, [None, _bits(values)])


def texts(values: Sequence[str]) -> Array:
    """A column of texts."""
    encoded = [value.encode() for value in values]
    ends = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    data = pa.py_buffer(b"".join(encoded))
    return pa.Array.from_buffers(pa.string(), len(encoded), [None, pa.py_buffer(ends), data])


def names(values: Iterable[str]) -> Array:
    """A column of texts that recur: each is stored once, in the order of first appearance."""
    place: dict[str, int] = {}
    codes = [place.setdefault(value, len(place)) for value in values]
    return coded(np.array(codes, dtype=np.int32), tuple(place))


def coded(codes: IntArray | npt.NDArray[np.signedinteger[Any]], meaning: Sequence[str]) -> Array:
    """A column of texts ``meaning[code]``."""
    return pa.DictionaryArray.from_arrays(numbers(codes), texts(meaning))


def lists(values: Array, size: int) -> Array:
    """A column of lists of ``size`` successive values each."""
    return pa.FixedSizeListArray.from_arrays(values, size)


def table(columns: dict[str, Array]) -> Array:
    """A table of named columns."""
    return pa.Table.from_arrays(list(columns.values()), list(columns))


def _bits(values: BoolArray) -> Array:
    """Truth values as Arrow packs them, the first in the lowest bit of the first byte."""
    return pa.py_buffer(np.packbits(values.reshape(-1), bitorder="little"))
