"""Detectors on the entrance lanes, and on the exit lanes that lead out of the network."""

from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from tsc_missing.config import SensorSettings
from tsc_missing.network.model import FloatArray, IntArray, Network
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.sensing.observation import N_FEATURES, QUEUE, VEHICLES, Measurement

HALTING_SPEED = 0.1  # [m/s]; slower vehicles are queueing
CENTIMETRE = 0.01  # [m]
VEHICLE_NUMBER = 0x10  # TraCI's variable: vehicles on the lane or detector
HALTING_NUMBER = 0x14  # TraCI's variable: those of them slower than 0.1 m/s


def write_area_detectors(network: Network, length: float, target: Path) -> None:
    """Write lane-area detectors: the last ``length`` m before stop lines, the first of exits.

    Where an entrance lane is shorter than ``length`` its detector goes on in the lanes upstream
    that its sensor reaches to.
    """
    lines = []
    for lane in covered_lanes(network, length):
        whole, distance = network.record.lanes[lane].length, _distance(network, lane)
        lines.append(_area(lane, lane, max(whole - (length - distance), 0.0), whole))
    for lane in _boundary(network):
        lines.append(
            _area(_exit_name(lane), lane, 0.0, min(length, network.record.lanes[lane].length))
        )
    target.write_text("\n".join(["<additional>", *lines, "</additional>", ""]), encoding="utf-8")


def covered_lanes(network: Network, length: float) -> tuple[str, ...]:
    """The lanes that sensors of ``length`` [m] before the stop lines see something of.

    The entrance lanes come first, in the network's order.
    """
    return tuple(lane for lane in network.sensor_lanes if _distance(network, lane) < length)


def _distance(network: Network, lane: str) -> float:
    """From the lane's end to the nearest stop line that it has a sensor for [m]."""
    if lane in network.entrance_lanes:
        return 0.0
    parts = (part for parts in network.reach.values() for part in parts)
    return min(part.distance for part in parts if part.lane == lane)


def _exit_name(lane: str) -> str:
    """The name of an exit's detector: the lane may have one at its other end too."""
    return f"exit:{lane}"


def _area(name: str, lane: str, start: float, end: float) -> str:
    """An element with positions to a centimetre, whose end is never beyond that of the lane."""
    last = round(end, 2)
    last = last if last <= end else last - CENTIMETRE
    return (
        f"<laneAreaDetector id={quoteattr(name)} lane={quoteattr(lane)} "
        f'pos="{min(start, last - CENTIMETRE):.2f}" endPos="{last:.2f}" file="NUL" '
        f'period="1000000" speedThreshold="{HALTING_SPEED}" timeThreshold="0"/>'
    )


def _boundary(network: Network) -> tuple[str, ...]:
    return tuple(dict.fromkeys(lane for lanes in network.boundary_lanes for lane in lanes))


class Detectors:
    """Reads all detectors at once; over TraCI every lane is subscribed to."""

    def __init__(self, network: Network, sensor: SensorSettings, api: Any) -> None:
        """``api`` is a running simulation's; for ``area`` it must have loaded the detectors."""
        self._network = network
        self._domain = api.lane if sensor.kind == "lane" else api.lanearea
        exits = _boundary(network)
        if sensor.kind == "lane":
            self._sensors, names = network.sensor_lanes, exits
        else:
            self._sensors = covered_lanes(network, sensor.length)
            names = tuple(map(_exit_name, exits))
        self._lanes = (*self._sensors, *names)
        self._exits = {lane: len(self._sensors) + k for k, lane in enumerate(exits)}
        self._vehicle = api.vehicle
        self._onward = {} if sensor.kind == "lane" else self._where_lanes_lead(api.lane)
        self._subscribed = not hasattr(api, "isLibsumo")  # a connection of TraCI
        if self._subscribed:
            for lane in self._lanes:
                self._domain.subscribe(lane, [VEHICLE_NUMBER, HALTING_NUMBER])
        self._lane, self._slot, self._weight = self._sensor_table()
        self._exit_lane, self._exit_slot = self._exit_table()

    def _where_lanes_lead(self, lanes: Any) -> dict[int, list[str]]:
        """For the sensors upstream, by their position, those that their lanes lead to."""
        found = {}
        for k in range(len(self._network.entrance_lanes), len(self._sensors)):
            after = {link[0] for link in lanes.getLinks(self._sensors[k])}
            found[k] = sorted(after.intersection(self._sensors))
        return found

    def _sensor_table(self) -> tuple[IntArray, IntArray, FloatArray]:
        """The network's table of sensors, of the lanes that are covered, by their position here."""
        position = {lane: k for k, lane in enumerate(self._sensors)}
        places = [position.get(lane, -1) for lane in self._network.sensor_lanes]
        lanes, slots, weights = self._network.sensor_slots
        here = np.array(places, dtype=np.int64)[lanes]
        return here[here >= 0], slots[here >= 0], weights[here >= 0]

    def _exit_table(self) -> tuple[IntArray, IntArray]:
        pairs = [
            (self._exits[lane], n * N_SLOTS + slot)
            for n, slots in enumerate(self._network.exit_lanes)
            for slot, lanes in enumerate(slots)
            for lane in lanes
            if lane in self._network.boundary_lanes[n]
        ]
        table = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        return table[:, 0], table[:, 1]

    def _counts(self) -> tuple[FloatArray, FloatArray]:
        """Vehicles on each lane, and the queue on each lane of a sensor, which come first.

        By calls in process, in one answer over TraCI: libsumo gathers what is subscribed to at
        every advance, which costs more than the calls.
        """
        if self._subscribed:
            found = self._domain.getAllSubscriptionResults()
            vehicles = [found[lane][VEHICLE_NUMBER] for lane in self._lanes]
            queue = [found[lane][HALTING_NUMBER] for lane in self._sensors]
        else:
            vehicles = list(map(self._domain.getLastStepVehicleNumber, self._lanes))
            halting = self._domain.getLastStepHaltingNumber
            queue = [
                halting(lane) if count else 0
                for lane, count in zip(self._sensors, vehicles, strict=False)
            ]
        for k, after in self._onward.items():
            twice = self._seen_twice(k, after) if vehicles[k] else ()
            vehicles[k] -= len(twice)
            queue[k] -= sum(self._vehicle.getSpeed(name) < HALTING_SPEED for name in twice)
        return np.array(vehicles, dtype=float), np.array(queue, dtype=float)

    def _seen_twice(self, sensor: int, after: list[str]) -> set[str]:
        """The vehicles on a lane-area detector that stand on one of those ``after`` it, too."""
        ids = self._domain.getLastStepVehicleIDs
        further = {name for lane in after for name in ids(lane)}
        return further.intersection(ids(self._sensors[sensor]))

    def read(self) -> Measurement:
        """The truth now, for all intersections and slots."""
        vehicles, queue = self._counts()
        n = self._network.n
        values = np.zeros((n * N_SLOTS, N_FEATURES))
        for feature, counts in ((VEHICLES, vehicles), (QUEUE, queue)):
            values[:, feature] = np.bincount(
                self._slot, self._weight * counts[self._lane], minlength=n * N_SLOTS
            )
        exits = np.bincount(self._exit_slot, vehicles[self._exit_lane], minlength=n * N_SLOTS)
        return Measurement(
            values.reshape(n, N_SLOTS, N_FEATURES), exits.reshape(n, N_SLOTS).astype(float)
        )
