"""What became of each movement in a run: who came and passed, their delay, queues and waits.

The sums are SUMO's own, of lanes and of trips; ``docs/metrics.md`` says what counts for what.
"""

from dataclasses import dataclass, fields

import numpy as np

from tsc_missing.demand.trips import first_slots
from tsc_missing.evaluation.metrics import Measured
from tsc_missing.evaluation.steps import Scene, Trace
from tsc_missing.network.model import BoolArray, FloatArray, IntArray, Network
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.sensing.observation import QUEUE


@dataclass(frozen=True)
class Movements:
    """All fields are (N, 12); NaN where a movement has nothing to average, or it is not known."""

    observed: FloatArray  # share of decision steps in which it reported
    vehicles: FloatArray  # that came: served, or still there or waiting to enter at the end
    served: FloatArray  # [vehicles] that left over the stop line
    total_time_loss: FloatArray  # [s] of all vehicles on the lanes that its sensors cover
    total_waiting_time: FloatArray  # [s] below 0.1 m/s, there
    total_depart_delay: FloatArray  # [s] waiting to enter, of trips whose first signal it is
    mean_queue: FloatArray  # [vehicles] at decision steps
    longest_queue: FloatArray  # [vehicles]
    longest_wait: FloatArray  # [s] with a queue and without a green

    def columns(self) -> dict[str, FloatArray]:
        """The fields, and the delays of a vehicle [s] in front of the totals."""
        found: dict[str, FloatArray] = {it.name: getattr(self, it.name) for it in fields(self)}
        lost, entry = self.total_time_loss, self.total_depart_delay
        means = {
            "delay": self._per_vehicle(lost + entry),
            "time_loss": self._per_vehicle(lost),
            "depart_delay": self._per_vehicle(entry),
            "waiting_time": self._per_vehicle(self.total_waiting_time),
        }
        first = ("observed", "vehicles", "served")
        return {**{name: found[name] for name in first}, **means, **found}

    def _per_vehicle(self, total: FloatArray) -> FloatArray:
        some = self.vehicles > 0
        return np.divide(total, self.vehicles, out=np.full_like(total, np.nan), where=some)


def measure_movements(
    scene: Scene, trace: Trace, measured: Measured, horizon: float, native: bool
) -> Movements:
    """From SUMO's outputs and the loop's trace.

    ``native``: SUMO runs the signals itself. The trace then holds one look at them a step, which
    misses greens, and longest waits are not known.
    """
    network, lanes, trips = scene.network, measured.lanes, measured.trips
    first = first_slots(scene.demand.trips, network)
    queue = trace.truth[..., QUEUE]
    served = _of_slots(network, network.lane_slots, lanes.left)
    there = _of_slots(network, network.sensor_slots, lanes.there)
    outside = _of_trips(network, first, ~trips.inserted)
    lasted = np.diff(trace.time, append=horizon)
    waits = np.full(served.shape, np.nan) if native else _longest_waits(network, trace, lasted)
    return Movements(
        observed=trace.mask.mean(axis=0),
        vehicles=served + there + outside,
        served=served,
        total_time_loss=_of_slots(network, network.sensor_slots, lanes.time_loss),
        total_waiting_time=_of_slots(network, network.sensor_slots, lanes.waiting_time),
        total_depart_delay=_of_trips(network, first, trips.depart_delay(horizon)),
        mean_queue=queue.mean(axis=0),
        longest_queue=queue.max(axis=0),
        longest_wait=waits,
    )


def _of_slots(
    network: Network, table: tuple[IntArray, IntArray, FloatArray], values: FloatArray
) -> FloatArray:
    """(N, 12): values of lanes by a table of lanes and slots, which has positions among them."""
    lanes, flat, weight = table
    sums = np.bincount(flat, weight * values[lanes], minlength=network.n * N_SLOTS)
    return np.asarray(sums.reshape(network.n, N_SLOTS))


def _of_trips(network: Network, first: IntArray, values: FloatArray | BoolArray) -> FloatArray:
    """(N, 12): the sum over trips (M,) of values, for the flat slots (M,) that they count for.

    As a lane that slots share counts for each in equal parts, so do those who will come on it.
    """
    some = first >= 0
    sums = np.bincount(first[some], values[some], minlength=network.n * N_SLOTS)
    lanes, flat, _ = network.lane_slots
    per_lane = (sums / np.maximum(network.slot_lane_count.ravel(), 1))[flat]
    on_lane = np.zeros(len(network.entrance_lanes))
    np.add.at(on_lane, lanes, per_lane)
    return _of_slots(network, network.lane_slots, on_lane)


def _longest_waits(network: Network, trace: Trace, lasted: FloatArray) -> FloatArray:
    green = network.phases[np.arange(network.n), trace.phase] | network.free_slots
    return longest_waits(trace.truth[..., QUEUE] > 0, green, lasted)


def longest_waits(queued: BoolArray, green: BoolArray, lasted: FloatArray) -> FloatArray:
    """The longest time [s] of successive steps with a queue and without a green.

    Of arrays (T, …) whether there was a queue at a step's start, and a green in it; ``lasted``
    (T,) is how long each step took.
    """
    waits = longest = np.zeros(queued.shape[1:])
    for waiting, seconds in zip(queued & ~green, lasted, strict=True):
        waits = np.where(waiting, waits + seconds, 0.0)
        longest = np.maximum(longest, waits)
    return longest
