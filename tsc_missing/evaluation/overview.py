"""What ``tsc-net show`` shows: a network, its demand where it has one, and a mask's coverage."""

import math
from dataclasses import dataclass
from pathlib import Path

from tsc_missing.config import MissingSettings, RunSettings
from tsc_missing.errors import UserError
from tsc_missing.evaluation.run_folder import MASK, RUN
from tsc_missing.evaluation.scenario import Scenario, find_scenario
from tsc_missing.network.coverage import Coverage
from tsc_missing.network.folder import (
    MANIFEST,
    ROUTES,
    NetworkFolder,
    bundled_profiles,
    canonical,
    imported_networks,
    read_folder,
)
from tsc_missing.network.model import BoolArray, Network
from tsc_missing.network.roads import Road, read_roads
from tsc_missing.network.summary import (
    NetworkSummary,
    Part,
    SensorSummary,
    summarise_network,
    summarise_sensors,
)
from tsc_missing.sensing.masks import load_mask
from tsc_missing.sensing.masks_of_runs import mask_file, mask_of
from tsc_missing.sensing.outage_list import is_list


class DemandSummary(Part):
    """The demand that a run would have."""

    kind: str
    vehicles: int
    horizon: int  # [s] that were looked at, or that the demand lasts if that is less


class Summary(Part):
    """All that is printed of a network."""

    name: str
    kind: str
    network: NetworkSummary
    demand: DemandSummary | None
    sensors: SensorSummary | None


@dataclass(frozen=True)
class Overview:
    """All that is shown of a network."""

    summary: Summary
    network: Network
    roads: tuple[Road, ...]
    coverage: Coverage | None


def look_at(settings: RunSettings, run_folder: Path | None = None) -> Overview:
    """Read the network, its demand and a mask: a file's, a run folder's or one that is drawn."""
    folder, scenario = find_network(settings)
    network = folder.network
    mask, source = _mask(settings, network, run_folder)
    coverage = Coverage.of_mask(mask, network.slot_mask) if mask is not None else None
    roads = read_roads(folder.net_file, network.record)
    summary = Summary(
        name=scenario.name if scenario is not None else folder.manifest.name,
        kind=folder.manifest.kind,
        network=summarise_network(network, roads),
        demand=_demand(settings, scenario) if scenario is not None else None,
        sensors=(
            summarise_sensors(coverage, network.ids, source, len(mask))
            if coverage is not None and mask is not None
            else None
        ),
    )
    return Overview(summary, network, roads, coverage)


def find_network(settings: RunSettings) -> tuple[NetworkFolder, Scenario | None]:
    """The network that ``--net`` means, and the scenario if it has a demand.

    A demand that was asked for by name has to be there.
    """
    name = canonical(settings.net)
    if settings.demand == "auto" and name not in bundled_profiles():
        path = imported_networks().get(name, Path(settings.net))
        if (path / MANIFEST).is_file() and not (path / ROUTES).exists():
            return read_folder(path, name), None
    scenario = find_scenario(settings.net, settings.demand)
    return scenario.folder, scenario


def _demand(settings: RunSettings, scenario: Scenario) -> DemandSummary:
    demand = scenario.demand(settings)
    return DemandSummary(
        kind=scenario.demand_kind,
        vehicles=len(demand.trips),
        horizon=math.ceil(min(settings.horizon, demand.duration)),
    )


def _mask(
    settings: RunSettings, network: Network, run_folder: Path | None
) -> tuple[BoolArray | None, str]:
    """The mask to show, if any, and where it is from."""
    if run_folder is not None:
        if not (run_folder / RUN).is_file():
            raise UserError("--run", run_folder, f"it has no {RUN}, so it is no run folder")
        if not (run_folder / MASK).is_file():
            raise UserError(
                "--run", run_folder, f"it has no {MASK}: its controller used no sensors"
            )
        return load_mask(run_folder / MASK, network), f"run {run_folder.resolve().name}"
    if settings.missing.pattern == "none":
        return None, ""
    path = mask_file(settings)
    if path is not None and not is_list(path):
        return load_mask(path, network), f"mask {path.name}"  # however long the run was
    mask = mask_of(settings, network)
    if path is not None:
        return mask, f"outages of {path.name}"
    return mask, f"{missing_words(settings.missing)}, seed {settings.seed_of_mask}"


def missing_words(missing: MissingSettings) -> str:
    """For example ``kriging (adjacent) 25 %``; of a file its name."""
    if missing.file:
        return missing.file_words
    details = f" ({missing.variant})" if missing.variant else ""
    return f"{missing.pattern}{details} {100 * missing.rate:g} %"
