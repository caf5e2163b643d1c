"""Several samples of what may be at intersections that nobody sees, in one plan.

Rows beside the N intersections of a network stand for further samples of some of them. What is
seen is the same in all samples, so only the intersections that are not are planned again.
"""

from collections.abc import Iterator
from dataclasses import replace

import torch
from torch import Tensor

from tsc_missing.diffusion.history import History
from tsc_missing.network.slots import N_SLOTS


def unseen(history: History) -> Tensor:
    """(R,): the intersections of which no slot is known in any of the C steps."""
    known = (history.known & history.slots.unsqueeze(1)).flatten(1).any(dim=1)
    return (~known).nonzero().squeeze(1)


def with_copies(history: History, rows: Tensor, copies: int) -> History:
    """The history of N intersections and, after them, ``copies`` times that of ``rows`` (R,).

    A copy's neighbours are copies of the same turn where there are such, else the intersections
    themselves; these do not hear of the copies.
    """
    if not copies or not len(rows):
        return history
    count = len(history.slots)
    repeated = {
        name: torch.cat((value, value[rows].repeat(copies, *[1] * (value.dim() - 1))))
        for name, value in vars(history).items()
        if name not in ("neighbours", "downstream")
    }
    tables = {
        name: torch.cat((table, *_moved(table[rows], rows, count, copies)))
        for name, table in (
            ("neighbours", history.neighbours),
            ("downstream", history.downstream),
        )
    }
    return replace(history, **repeated, **tables)


def _moved(table: Tensor, rows: Tensor, count: int, copies: int) -> Iterator[Tensor]:
    """A table of flat slots, -1 for none, for each copy, which has its own rows."""
    for copy in range(copies):
        place = torch.arange(count)
        place[rows] = count + copy * len(rows) + torch.arange(len(rows))
        flat = table.clamp(min=0)
        moved = place[flat // N_SLOTS] * N_SLOTS + flat % N_SLOTS
        yield torch.where(table >= 0, moved, table)


def all_samples(planned: Tensor, rows: Tensor, count: int) -> Tensor:
    """(M, N, …): the samples in what was planned (N + copies·R, …) for N = ``count``.

    The first is that of the N intersections; in the others their ``rows`` (R,) are of a copy.
    """
    first, copies = planned[:count], planned[count:]
    if not len(copies):
        return first.unsqueeze(0)
    others = copies.view(-1, len(rows), *copies.shape[1:])
    found = first.repeat(1 + len(others), *[1] * first.dim())
    found[1:, rows] = others
    return found
