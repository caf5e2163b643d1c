"""Signal programs that SUMO runs itself, for comparison."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tsc_missing.config import SignalSettings
from tsc_missing.network.model import IntArray, Network
from tsc_missing.simulation.native import (
    ACTUATED,
    AS_BUILT,
    PROGRAM_ID,
    RECALL,
    native_program_xml,
)
from tsc_missing.simulation.states import green_state, sumo_state


@dataclass(frozen=True)
class NativeProgram:
    """Programs that SUMO runs at every intersection.

    ``kind`` is one of ``native.KINDS``, ``RECALL``, or ``AS_BUILT`` for those of the network.
    """

    kind: str
    network: Network

    @property
    def sees_all(self) -> bool:
        """Whether nothing is ever missing for it."""
        return self.kind != RECALL

    def write(self, signals: SignalSettings, target: Path) -> bool:
        """Write the additional file that defines the programs; false if none is needed."""
        if self.kind == AS_BUILT:
            return False
        body = native_program_xml(self.network, self._type, signals)
        target.write_text(f"<additional>\n{body}\n</additional>\n", encoding="utf-8")
        return True

    @property
    def _type(self) -> str:
        """What SUMO calls it."""
        return ACTUATED if self.kind == RECALL else self.kind

    def start(self, api: Any) -> None:
        """Switch every signal to its program; those of the network run from the start."""
        if self.kind == AS_BUILT:
            return
        for name in self.network.ids:
            api.trafficlight.setProgram(name, PROGRAM_ID)

    def phases(self, api: Any) -> IntArray:
        """(N,): the phase that is green now, -1 between two."""
        return np.array([self._phase(n, api) for n in range(self.network.n)], dtype=np.int64)

    def _phase(self, n: int, api: Any) -> int:
        node = self.network.intersections[n]
        shown = api.trafficlight.getRedYellowGreenState(node.id)
        states = [sumo_state(node, green_state(node, phase)) for phase in range(len(node.phases))]
        return states.index(shown) if shown in states else -1
