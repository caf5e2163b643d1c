"""Which sensors do not report, as a list: a CSV file of outages.

Its columns are ``intersection``, ``slot``, ``begin`` and ``end``; all but the first may be left out
or empty. A slot is one movement (``N-left``), or an approach with all of its movements (``N``);
without it none of the intersection reports. Begin and end are seconds since the begin of the run,
the end excluded; without them the outage lasts from its begin, or to its end. Movements that share
lanes fall silent together.
"""

import csv
import io
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np
from pydantic import Field, ValidationError

from tsc_missing.config import Settings
from tsc_missing.errors import UserError, nearest
from tsc_missing.files import first_problem
from tsc_missing.network.model import BoolArray, Network
from tsc_missing.network.slots import APPROACHES, N_SLOTS, TURNS, slot_name

FIELD = "mask"
SUFFIX = ".csv"
SLOTS = tuple(slot_name(slot) for slot in range(N_SLOTS))


class Outage(Settings):
    """One line of the list."""

    intersection: str
    slot: str = ""
    begin: float = Field(0.0, ge=0)  # [s]
    end: float = Field(math.inf, gt=0, allow_inf_nan=True)  # [s]


COLUMNS = tuple(Outage.model_fields)


def is_list(path: Path) -> bool:
    """Whether a file's name says that it is a list of outages."""
    return path.suffix.lower() == SUFFIX


def read_outages(path: Path, network: Network, steps: int, interval: float) -> BoolArray:
    """(T, N, 12): what reports at each of ``steps`` decision steps, ``interval`` [s] apart.

    Raises ``UserError`` with the line that is wrong.
    """
    mask = np.ones((steps, network.n, N_SLOTS), dtype=bool)
    time = np.arange(steps) * interval
    for line, outage in _lines(path):
        if outage.intersection not in network.ids:
            known = nearest(outage.intersection, network.ids)
            _wrong(path, line, f"no intersection {outage.intersection} in {network.name}; {known}")
        n = network.ids.index(outage.intersection)
        slots = _slots(outage.slot)
        if slots is None:
            known = nearest(outage.slot, (*APPROACHES, *SLOTS))
            _wrong(path, line, f"no slot {outage.slot}; {known}")
        silent = slots & network.slot_mask[n]
        if not silent.any():
            there = ", ".join(SLOTS[k] for k in np.flatnonzero(network.slot_mask[n]))
            _wrong(path, line, f"{outage.intersection} has no {outage.slot}; it has {there}")
        common = network.slots_in_common[n]
        silent = np.isin(common, common[silent]) & network.slot_mask[n]
        during = (outage.begin <= time) & (time < outage.end)
        mask[:, n] &= ~(during[:, None] & silent)
    if mask.all():
        last = f"{steps * interval:g} s of the run, with a decision every {interval:g} s"
        raise UserError(FIELD, path, f"no outage is in the {last}; times count from its begin")
    return mask


def _lines(path: Path) -> Iterator[tuple[int, Outage]]:
    """The outages with the numbers of their lines; at least one."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        reason = error.strerror or "damaged"
        raise UserError(FIELD, path, f"the file cannot be read ({reason})") from None
    except UnicodeDecodeError:
        raise UserError(FIELD, path, "it is no text in UTF-8") from None
    head = text.lstrip().partition("\n")[0]
    separator = ";" if ";" in head else ","  # as spreadsheets of some countries write
    reader = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True, delimiter=separator)
    columns: tuple[str, ...] = ()
    count = 0
    try:
        for values in reader:
            row = [value.strip() for value in values]
            if not any(row):
                continue
            if not columns:
                columns = _columns(path, reader.line_num, row)
            else:
                count += 1
                yield reader.line_num, _outage(path, reader.line_num, columns, row)
    except csv.Error as error:
        _wrong(path, reader.line_num, f"it is no CSV ({error})")
    if not count:
        raise UserError(FIELD, path, f"it lists no outage; its columns are {', '.join(COLUMNS)}")


def _columns(path: Path, line: int, names: Sequence[str]) -> tuple[str, ...]:
    """The names of the first line that is not empty."""
    for name in names:
        if name not in COLUMNS:
            found = name or "without a name"
            _wrong(path, line, f"unknown column {found}; {nearest(name, COLUMNS)}")
    if len(set(names)) < len(names):
        _wrong(path, line, "a column is there twice")
    if COLUMNS[0] not in names:
        _wrong(path, line, f"it must have a column {COLUMNS[0]}")
    return tuple(names)


def _outage(path: Path, line: int, columns: Sequence[str], row: Sequence[str]) -> Outage:
    if len(row) > len(columns):
        _wrong(path, line, "more values than columns")
    given = {name: value for name, value in zip(columns, row, strict=False) if value}
    if COLUMNS[0] not in given:
        _wrong(path, line, f"no {COLUMNS[0]}")
    try:
        outage = Outage.model_validate(given)
    except ValidationError as error:
        _wrong(path, line, first_problem(error))
    if outage.end <= outage.begin:
        _wrong(path, line, f"end {outage.end:g} must be after begin {outage.begin:g}")
    return outage


def _wrong(path: Path, line: int, words: str) -> NoReturn:
    raise UserError(FIELD, path, f"line {line}: {words}")


def _slots(name: str) -> BoolArray | None:
    """(12,): the slots that a name means; None where it means none."""
    if not name:
        return np.ones(N_SLOTS, dtype=bool)
    if name in APPROACHES:
        return np.asarray(np.arange(N_SLOTS) // len(TURNS) == APPROACHES.index(name))
    return np.array([slot == name for slot in SLOTS]) if name in SLOTS else None
