"""Episode logs: what a model may learn from one run, as a Parquet file.

A row is a decision step and an intersection, steps outermost. ``vehicles``, ``queue``,
``red_steps`` and ``mask`` are lists over the 12 slots. A log that is complete has no ``mask``. In
one with holes the cells that did not report hold zeros: the truth is not in the file at all.
"""

import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from tsc_missing.errors import UserError
from tsc_missing.evaluation.steps import Trace
from tsc_missing.files import replace_file
from tsc_missing.network.model import BoolArray, IntArray, Network
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.sensing.observation import QUEUE, VEHICLES

FORMAT = 1
FIELD = "data"
LARGEST = np.iinfo(np.uint16).max

Float32Array = npt.NDArray[np.float32]


@dataclass(frozen=True)
class EpisodeLog:
    """T decision steps of N intersections; row t is the state at the start of step t."""

    values: Float32Array  # (T, N, 12, F) vehicles, queue; 0 where not recorded
    phase: IntArray  # (T, N) that ran from t to t + 1
    red_steps: IntArray  # (T, N, 12) decision steps since the last green; 0: had it just now
    mask: BoolArray | None  # (T, N, 12) true = recorded; None where all is

    @property
    def green(self) -> BoolArray:
        """(T, N, 12): the slot was green in the step that ended here."""
        return np.asarray(self.red_steps == 0)

    @property
    def recorded(self) -> BoolArray:
        """(T, N, 12): the mask, all true where there is none."""
        if self.mask is not None:
            return self.mask
        return np.ones(self.red_steps.shape, dtype=bool)


def log_of(trace: Trace, network: Network, mask: BoolArray | None) -> EpisodeLog:
    """The log of a run; with a mask (T, N, 12) the truth under it is left out."""
    values = trace.truth.astype(np.float32)
    if mask is not None:
        values = np.where(mask[..., None], values, np.float32(0))
    return EpisodeLog(values, trace.phase, red_steps_of(network, trace.phase), mask)


def red_steps_of(network: Network, phase: IntArray) -> IntArray:
    """(T, N, 12): at the start of each step, the steps since a slot last had green.

    ``phase`` (T, N) is what ran in each step. Before the first step only free slots were green,
    and the others count as red for one step.
    """
    red = network.first_red_steps()
    rows = []
    for running in phase:
        rows.append(red)
        red = network.next_red_steps(red, running)
    return np.array(rows, dtype=np.int64).reshape(*phase.shape, N_SLOTS)


def write_log(path: Path, log: EpisodeLog, about: dict[str, Any]) -> None:
    """Write a log and ``about`` (JSON values), whole or not at all."""
    columns = {
        "phase": pa.array(log.phase.ravel().astype(np.int8)),
        "vehicles": _lists(_compact(log.values[..., VEHICLES])),
        "queue": _lists(_compact(log.values[..., QUEUE])),
        "red_steps": _lists(np.minimum(log.red_steps, LARGEST).astype(np.uint16)),
    }
    if log.mask is not None:
        columns["mask"] = _lists(log.mask)
    steps, n = log.phase.shape
    header = {"format": FORMAT, "steps": steps, "intersections": n, "about": about}
    table = pa.table(columns).replace_schema_metadata({"episode": json.dumps(header)})
    content = io.BytesIO()
    pq.write_table(table, content, compression="zstd")
    try:
        replace_file(path, content.getvalue())
    except OSError as error:
        raise UserError(FIELD, path, f"cannot be written ({error.strerror or error})") from error


def read_log(path: Path) -> tuple[EpisodeLog, dict[str, Any]]:
    """The log of a file, and what was written ``about`` it."""
    try:
        table = pq.read_table(path)
        header = json.loads(table.schema.metadata[b"episode"])
    except OSError as error:
        reason = error.strerror or "damaged"
        raise UserError(FIELD, path, f"the file cannot be read ({reason})") from None
    except (pa.ArrowException, KeyError, TypeError, ValueError):
        raise UserError(FIELD, path, "not an episode log, or cut off") from None
    if header.get("format") != FORMAT:
        found = header.get("format")
        raise UserError(FIELD, path, f"it has format {found}, and this program reads {FORMAT}")
    shape = (header["steps"], header["intersections"])
    vehicles, queue = (_array(table, name, shape) for name in ("vehicles", "queue"))
    log = EpisodeLog(
        values=np.stack((vehicles, queue), axis=-1).astype(np.float32),
        phase=table["phase"].to_numpy().astype(np.int64).reshape(shape),
        red_steps=_array(table, "red_steps", shape).astype(np.int64),
        mask=_array(table, "mask", shape) if "mask" in table.column_names else None,
    )
    return log, header["about"]


def _compact(counts: Float32Array) -> npt.NDArray[Any]:
    """As uint16 where all are whole numbers (lanes that slots share give fractions)."""
    whole = counts.astype(np.uint16)
    return whole if np.array_equal(whole, counts) else counts


def _lists(values: npt.NDArray[Any]) -> Any:
    return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), N_SLOTS)


def _array(table: Any, name: str, shape: tuple[int, int]) -> npt.NDArray[Any]:
    flat = table[name].combine_chunks().flatten().to_numpy(zero_copy_only=False)
    return np.asarray(flat).reshape(*shape, N_SLOTS)
