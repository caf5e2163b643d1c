"""Detectors of SUMO's actuated programs that fail, and what controllers in the field do then."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from tsc_missing.network.model import BoolArray, Network
from tsc_missing.simulation.native import PROGRAM_ID

OCCUPIED = 0.0  # [s] since a detector's last vehicle, as SUMO is told,
NOBODY = 1e6  # [s] where nobody has come for long;
MEASURED = -1.0  # below 0 the detector itself says it
GREEN = "Gg"  # in states of signals


class MaximumRecall:
    """Takes the detectors of lanes whose sensors are silent to be occupied all the time.

    A green that one of them prolongs then lasts to its maximum: "maximum recall". Lanes that are
    green in every phase need none, so their detectors then prolong nothing.
    """

    def __init__(self, network: Network, api: Any) -> None:
        """``api`` is a running simulation's, which has loaded the actuated programs."""
        self._override = api.inductionloop.overrideTimeSinceDetection
        loops = dict(pair for name in network.ids for pair in _loops(name, api))
        self._loops = [loops.get(lane) for lane in network.entrance_lanes]
        self._lanes, self._slots, _ = network.lane_slots
        bound = np.bincount(self._lanes, ~network.free_slots.ravel()[self._slots]) > 0
        self._failed = np.where(bound, OCCUPIED, NOBODY)  # of each lane
        self._silent = np.zeros(len(self._loops), dtype=bool)

    def update(self, reported: BoolArray) -> None:
        """Take in which slots (N, 12) report from now on; a lane is silent with any of its own."""
        unheard = ~reported.reshape(-1)[self._slots]
        silent = np.bincount(self._lanes, unheard, minlength=len(self._loops)) > 0
        for k in np.flatnonzero(silent != self._silent):
            if (loop := self._loops[k]) is not None:
                self._override(loop, float(self._failed[k]) if silent[k] else MEASURED)
        self._silent = silent


def _loops(name: str, api: Any) -> Iterator[tuple[str, str]]:
    """The lanes that a signal's actuated program has a detector for, with the detector's id.

    SUMO numbers the roads in the order of the signal's links, and the lanes of each. The lane that
    a detector lies on does not tell which it is for: for a short one it is put upstream, where
    several may have theirs. A program whose greens have one length has no detectors.
    """
    programs = api.trafficlight.getAllProgramLogics(name)
    (phases,) = (program.phases for program in programs if program.programID == PROGRAM_ID)
    greens = [phase.state for phase in phases if phase.minDur < phase.maxDur]
    seen = set()
    road, number, last = -1, 0, ""
    for k, links in enumerate(api.trafficlight.getControlledLinks(name)):
        for lane, _, _ in links:
            is_crossing = lane.startswith(":")
            if lane in seen or is_crossing or not any(green[k] in GREEN for green in greens):
                continue
            seen.add(lane)
            edge = api.lane.getEdgeID(lane)
            road, number = (road, number + 1) if edge == last else (road + 1, 0)
            last = edge
            yield lane, f"{name}_{PROGRAM_ID}_D{road}.{number}"
