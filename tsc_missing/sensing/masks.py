"""Masks as files, and what share of them is missing.

The file is a compressed npz without pickled objects: ``format``, ``mask`` (T, N, 12) bool, true =
reported, ``intersections`` (N,) and ``slots`` (12,) their names.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tsc_missing.errors import UserError
from tsc_missing.network.model import BoolArray, Network
from tsc_missing.network.slots import N_SLOTS, slot_name

FORMAT = 1
SLOTS = tuple(slot_name(slot) for slot in range(N_SLOTS))
FIELDS = ("format", "mask", "intersections", "slots")


def save_mask(path: Path, mask: BoolArray, intersection_ids: Sequence[str]) -> None:
    """Write a mask (T, N, 12) to a file; the same mask always gives the same bytes."""
    with path.open("wb") as stream:
        np.savez_compressed(
            stream,
            format=np.array(FORMAT),
            mask=mask,
            intersections=np.array(intersection_ids, dtype=np.str_),
            slots=np.array(SLOTS),
        )


def load_mask(path: Path, network: Network, steps: int | None = None) -> BoolArray:
    """(T, N, 12): a mask that was saved for the same intersections.

    Its first ``steps`` steps, or all of them.
    """
    fields = _read(path)
    if fields["format"].tolist() != FORMAT:
        raise UserError("mask", path, f"it must be a mask file of format {FORMAT}")
    if fields["slots"].tolist() != list(SLOTS):
        raise UserError("mask", path, f"its slots must be {', '.join(SLOTS)}")
    if fields["intersections"].tolist() != list(network.ids):
        raise UserError(
            "mask", path, f"it must be of network {network.name}, and names other intersections"
        )
    mask: BoolArray = fields["mask"]
    if mask.dtype != np.bool_ or mask.ndim != 3 or mask.shape[1:] != (network.n, N_SLOTS):
        raise UserError(
            "mask",
            path,
            f"its array must be bool (steps, {network.n}, {N_SLOTS}), found {mask.dtype} "
            f"{mask.shape}",
        )
    if steps is not None and len(mask) < steps:
        raise UserError(
            "mask", path, f"it must hold at least the run's {steps} steps, found {len(mask)}"
        )
    return mask[:steps] | ~network.slot_mask


def _read(path: Path) -> dict[str, npt.NDArray[Any]]:
    """All fields of the file.

    A damaged archive can fail in any way that its decoders know, so all of them are the user's.
    """
    try:
        with path.open("rb") as stream:
            archive = np.load(stream, allow_pickle=False)
            return {name: archive[name] for name in FIELDS}
    except OSError as error:
        reason = error.strerror or "damaged"
        raise UserError("mask", path, f"the file cannot be read ({reason})") from None
    except Exception:
        raise UserError(
            "mask",
            path,
            "it is not a mask file (npz), or cut off; a list of outages must end in .csv",
        ) from None


def missing_share(mask: BoolArray, slot_mask: BoolArray) -> float:
    """The share of cells of a mask (T, N, 12) that is missing, over the slots that are there."""
    return 1.0 - float(mask[:, slot_mask].mean())
