"""SUMO's own outputs: one record a trip, totals a lane, and the totals of the run."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np

from tsc_missing.network.model import BoolArray, FloatArray


@dataclass(frozen=True)
class OutputFiles:
    """Where SUMO writes; ``folder`` is made by the caller."""

    folder: Path

    @property
    def trips(self) -> Path:
        """SUMO's tripinfo output."""
        return self.folder / "tripinfo.xml"

    @property
    def statistics(self) -> Path:
        """SUMO's statistic output."""
        return self.folder / "statistics.xml"

    @property
    def lanes(self) -> Path:
        """SUMO's lane-based mean data over the whole run."""
        return self.folder / "lanes.xml"

    def options(self) -> tuple[str, ...]:
        """The SUMO options that ask for them."""
        return (
            f"--tripinfo-output={self.trips}",
            "--tripinfo-output.write-unfinished",
            "--tripinfo-output.write-undeparted",
            f"--statistic-output={self.statistics}",
        )

    def write_lane_request(self, target: Path) -> None:
        """Write the additional file that asks for the lane data."""
        target.write_text(
            f'<additional><laneData id="lanes" file="{self.lanes}" excludeEmpty="true" '
            'withInternal="false"/></additional>\n',
            encoding="utf-8",
        )


@dataclass(frozen=True)
class TripTimes:
    """Times of M trips, in the order of the demand; NaN where a trip did not get so far."""

    scheduled: FloatArray  # [s]
    depart: FloatArray  # [s]
    arrival: FloatArray  # [s]
    time_loss: FloatArray  # [s]
    waiting_time: FloatArray  # [s] below 0.1 m/s
    route_length: FloatArray  # [m] driven
    stops: FloatArray  # times that it came below 0.1 m/s

    @property
    def inserted(self) -> BoolArray:
        """Whether the vehicle entered the network."""
        return np.isfinite(self.depart)

    @property
    def finished(self) -> BoolArray:
        """Whether it arrived."""
        return np.isfinite(self.arrival)

    def travel_time(self, horizon: float) -> FloatArray:
        """(arrival, or the horizon) minus the scheduled departure [s]."""
        return np.where(self.finished, self.arrival, horizon) - self.scheduled

    def depart_delay(self, horizon: float) -> FloatArray:
        """(departure, or the horizon) minus the scheduled departure [s]."""
        return np.where(self.inserted, self.depart, horizon) - self.scheduled


COLUMNS = ("depart", "arrival", "timeLoss", "waitingTime", "routeLength", "waitingCount")


def read_trips(path: Path, scheduled: FloatArray, begin: float = 0.0) -> TripTimes:
    """The trips of a tripinfo file whose vehicles are named by their position in the demand.

    ``scheduled`` and what is returned count from ``begin`` [s] on SUMO's clock.
    """
    table = np.full((len(scheduled), len(COLUMNS)), np.nan)

    def element(tag: str, values: dict[str, str]) -> None:
        if tag == "tripinfo" and float(values.get("depart", "-1")) >= 0:
            table[int(values["id"])] = [float(values.get(c, "nan")) for c in COLUMNS]

    _parse(path, element)
    depart, arrival, time_loss, waiting_time, route_length, stops = table.T
    arrival = np.where(arrival >= 0, arrival, np.nan) - begin
    return TripTimes(
        scheduled, depart - begin, arrival, time_loss, waiting_time, route_length, stops
    )


LANE_COLUMNS = (
    "sampledSeconds",
    "timeLoss",
    "waitingTime",
    "left",
    "departed",
    "entered",
    "laneChangedTo",
    "laneChangedFrom",
    "arrived",
)


@dataclass(frozen=True)
class LaneTotals:
    """What SUMO sums up over the run on each of K lanes."""

    seconds: FloatArray  # [s] that vehicles spent on it
    time_loss: FloatArray  # [s] against driving at the allowed speed
    waiting_time: FloatArray  # [s] below 0.1 m/s
    left: FloatArray  # [vehicles] that drove off its end
    there: FloatArray  # [vehicles] on it at the run's end


def read_lanes(path: Path, lanes: Sequence[str]) -> LaneTotals:
    """The totals of the given lanes; one that the file does not have was always empty."""
    position = {lane: k for k, lane in enumerate(lanes)}
    table = np.zeros((len(lanes), len(LANE_COLUMNS)))

    def element(tag: str, values: dict[str, str]) -> None:
        if tag == "lane" and values["id"] in position:
            table[position[values["id"]]] = [float(values.get(c, "0")) for c in LANE_COLUMNS]

    _parse(path, element)
    seconds, time_loss, waiting_time, left, departed, entered, to, off, arrived = table.T
    there = departed + entered + to - off - left - arrived
    return LaneTotals(seconds, time_loss, waiting_time, left, there)


def _parse(path: Path, element: Callable[[str, dict[str, str]], None]) -> None:
    """Call ``element`` with the name and attributes of each; ElementTree makes objects of them."""
    parser = expat.ParserCreate()
    parser.StartElementHandler = element
    with path.open("rb") as stream:
        parser.ParseFile(stream)


@dataclass(frozen=True)
class Totals:
    """What SUMO itself counted over the run."""

    teleports: int
    collisions: int
    emergency_brakings: int
    vehicles: int  # inserted
    travel_time: float  # [s] from insertion on, summed over inserted vehicles
    depart_delay: float  # [s] summed over all vehicles, inserted or not


def read_totals(path: Path) -> Totals:
    """The totals of a statistics file."""
    root = ElementTree.parse(path).getroot()

    def value(tag: str, name: str) -> float:
        element = root.find(tag)
        return float(element.get(name, "0")) if element is not None else 0.0

    return Totals(
        teleports=int(value("teleports", "total")),
        collisions=int(value("safety", "collisions")),
        emergency_brakings=int(value("safety", "emergencyBraking")),
        vehicles=int(value("vehicleTripStatistics", "count")),
        travel_time=value("vehicleTripStatistics", "totalTravelTime"),
        depart_delay=value("vehicleTripStatistics", "totalDepartDelay"),
    )
