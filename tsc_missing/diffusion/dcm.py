"""The diffusion communication mechanism: neighbours tell each other what they generate."""

from dataclasses import replace

import torch
from torch import Tensor

from tsc_missing.diffusion.batch import Inputs, gather_downstream, gather_neighbours


class Communication:
    """τ'_nei over the reverse steps (Eq. in "Diffusion Communication Mechanism").

    At k = K neighbours give what they observed, with zeros for the rest; at every later step
    their last x̂^0 with the known cells written in. Switched off, they go on giving the first.
    """

    def __init__(
        self, inputs: Inputs, values: Tensor, table: Tensor, downstream: Tensor, enabled: bool
    ) -> None:
        """``values`` (N, T, L, F) count where known.

        ``table`` (N, G, 3) and ``downstream`` (N, L, D) are of flat slots.
        """
        self._known = inputs.known
        self._there = inputs.slots.unsqueeze(1).expand_as(inputs.known)
        self._values = values
        self._table = table
        self._downstream = downstream
        self._enabled = enabled
        self.inputs = self._with_neighbours(inputs, values, inputs.known)

    def exchange(self, x0: Tensor) -> None:
        """Let every intersection hand its x̂^0 (N, T, L, F) on; changes ``inputs``."""
        if self._enabled:
            told = torch.where(self._known.unsqueeze(-1), self._values, x0)
            self.inputs = self._with_neighbours(self.inputs, told, self._there)

    def _with_neighbours(self, inputs: Inputs, values: Tensor, given: Tensor) -> Inputs:
        return replace(
            inputs,
            neighbours=gather_neighbours(values, given, inputs.signals, self._table),
            downstream=gather_downstream(values, given, self._downstream),
        )
