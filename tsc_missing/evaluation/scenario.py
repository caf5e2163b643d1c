"""From names to a network and its demand: what ``--net`` and ``--demand`` mean."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from tsc_missing.config import RunSettings
from tsc_missing.demand.profile import draw_demand, read_profile, record_turns
from tsc_missing.demand.sumo import read_routes
from tsc_missing.demand.trips import Demand
from tsc_missing.errors import UserError
from tsc_missing.evaluation.steps import Scene
from tsc_missing.files import sha256
from tsc_missing.network.folder import (
    MANIFEST,
    NetworkFolder,
    bundled_profiles,
    canonical,
    city_of,
    imported_networks,
    read_folder,
    unknown_network,
)
from tsc_missing.network.model import BoolArray
from tsc_missing.paths import bundled


@dataclass(frozen=True)
class Scenario:
    """A network and where its demand comes from; ``demand_file`` is a profile or a route file."""

    name: str
    folder: NetworkFolder
    demand_kind: Literal["profile", "recorded", "generated"]
    demand_file: Path

    def checksums(self) -> dict[str, str]:
        """The SHA-256 of the net, its record and the demand file."""
        files = self.folder.manifest.files
        return {**files, f"demand: {self.demand_file.name}": sha256(self.demand_file)}

    def demand(self, settings: RunSettings) -> Demand:
        """The trips of a run; a profile's are drawn with the run's seed and volume."""
        if self.demand_kind != "profile":
            if settings.volume != 1.0:
                raise UserError(
                    "volume", settings.volume, f"{self.demand_kind} demand has only volume 1"
                )
            demand = read_routes(self.demand_file, settings.horizon, self.folder.begin)
            return replace(demand, duration=self.folder.manifest.horizon or math.inf)
        turns = record_turns(self.folder.network.record)
        profile = read_profile(self.demand_file)
        return draw_demand(profile, turns, settings.seed, settings.volume, settings.horizon)

    def scene(self, settings: RunSettings, mask: BoolArray) -> Scene:
        """All that a run with that mask (T, N, 12) needs besides its settings."""
        folder = self.folder
        return Scene(
            folder.network,
            folder.net_file,
            self.demand(settings),
            mask,
            folder.begin,
            folder.signals_file,
        )


def find_scenario(net: str, demand: Literal["auto", "profile", "recorded"]) -> Scenario:
    """The scenario of a name (bundled or imported) or of a network folder's path.

    ``auto`` takes the bundled profile where there is one, and else the recorded demand.
    """
    name = canonical(net)
    profiles, imported = bundled_profiles(), imported_networks()
    if name in profiles and demand != "recorded":
        return _bundled(name, profiles[name])
    if name in imported:
        return _recorded(net, name, imported[name], demand)
    if name in profiles:
        raise UserError(
            "demand",
            "recorded",
            f"{name} has not been imported: tsc-net import --as {name} does that, or use profile",
        )
    path = Path(net)
    if (path / MANIFEST).is_file() or ("/" in net and path.is_dir()):
        return _recorded(net, path.resolve().name, path, demand)
    if "/" in net:
        raise UserError("net", net, "there is no such folder")
    raise unknown_network(net)


def _bundled(name: str, profile: Path) -> Scenario:
    folder = read_folder(bundled("networks") / city_of(name), name)
    return Scenario(name, folder, "profile", profile)


def _recorded(net: str, name: str, path: Path, demand: str) -> Scenario:
    folder = read_folder(path, net)
    if demand == "profile":
        raise UserError(
            "demand",
            "profile",
            f"{name} has no bundled demand, only its own: auto or recorded takes that",
        )
    if folder.routes_file is None:
        words = "import it with --routes, --flow or --vehicles-per-hour"
        raise UserError("demand", demand, f"{path} holds a network without a demand; {words}")
    return Scenario(name, folder, folder.manifest.demand or "recorded", folder.routes_file)
