"""The diffusion communication mechanism: neighbours tell each other what they generate."""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from tsc_missing.diffusion.batch import Inputs, gather_downstream, gather_neighbours, rows_of


@dataclass(frozen=True)
class _Listeners:
    """Intersections, and the flat slots (R, G, 3) and (R, L, D) that they hear from."""

    inputs: Inputs
    table: Tensor
    downstream: Tensor

    def of(self, rows: Tensor) -> "_Listeners":
        """Some of them only."""
        return _Listeners(rows_of(self.inputs, rows), self.table[rows], self.downstream[rows])

    def hear(self, values: Tensor, given: Tensor, signals: Tensor) -> Inputs:
        """Their inputs with what all N tell, of which ``given`` (N, T, L) counts."""
        return replace(
            self.inputs,
            neighbours=gather_neighbours(values, given, signals, self.table),
            downstream=gather_downstream(values, given, self.downstream),
        )


class Communication:
    """τ'_nei over the reverse steps (Eq. in "Diffusion Communication Mechanism").

    At k = K neighbours give what they observed, with zeros for the rest; at every later step
    their last x̂^0 with the known cells written in. Switched off, they go on giving the first.
    """

    def __init__(
        self,
        inputs: Inputs,
        values: Tensor,
        table: Tensor,
        downstream: Tensor,
        enabled: bool,
        rows: Tensor | None = None,
    ) -> None:
        """``values`` (N, T, L, F) count where known.

        ``table`` (N, G, 3) and ``downstream`` (N, L, D) are of flat slots; ``rows`` (R,) are the
        intersections that can be asked for alone.
        """
        self._known = inputs.known
        self._there = inputs.slots.unsqueeze(1).expand_as(inputs.known)
        self._signals = inputs.signals
        self._values = values
        self._enabled = enabled
        self._told = values, inputs.known
        self._everyone = _Listeners(inputs, table, downstream)
        self._some = None if rows is None else self._everyone.of(rows)

    def exchange(self, x0: Tensor) -> None:
        """Let every intersection hand its x̂^0 (N, T, L, F) on."""
        if self._enabled:
            self._told = torch.where(self._known.unsqueeze(-1), self._values, x0), self._there

    def inputs(self, only_rows: bool = False) -> Inputs:
        """Those of all intersections, or of the ``rows`` only, with what they are told now."""
        listeners = self._some if only_rows and self._some is not None else self._everyone
        return listeners.hear(*self._told, self._signals)
