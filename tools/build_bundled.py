"""Rebuild everything that is bundled, from the grid specifications and the recorded flows.

    python -m tools.build_bundled --shared ../shared

writes ``networks/<city>/{net.net.xml,network.json,manifest.json}`` and
``scenarios/demand/<dataset>.json``. Of the recorded flows only statistics are kept
(``demand.fit``). The same inputs and SUMO version give the same bytes.
"""

import argparse
import json
from pathlib import Path

from tools.datasets import DATASETS, Dataset
from tsc_missing.demand.cityflow import read_flow
from tsc_missing.demand.fit import fit_profile
from tsc_missing.demand.profile import DemandProfile
from tsc_missing.files import sha256
from tsc_missing.network.folder import Manifest, builder_versions, write_manifest
from tsc_missing.network.grid import build_grid, read_grid
from tsc_missing.network.importing import build_network

ROOT = Path(__file__).resolve().parents[1]
SPECIFICATION = "grid.toml"
HORIZON = 3600


def build_city(city: str) -> None:
    """Build the network of a city from its grid specification."""
    folder = ROOT / "networks" / city
    specification = folder / SPECIFICATION
    record = build_network(build_grid(read_grid(specification)), folder)
    manifest = Manifest(
        name=city,
        kind="grid",
        intersections=len(record.intersections),
        sources={SPECIFICATION: sha256(specification)},
        versions=builder_versions(),
    )
    write_manifest(folder, manifest)


def build_profile(dataset: Dataset, shared: Path) -> None:
    """Fit the profile of a dataset's recorded flow."""
    plain = build_grid(read_grid(ROOT / "networks" / dataset.city / SPECIFICATION))
    profile = fit_profile(read_flow(dataset.flow(shared), plain, HORIZON), plain)
    target = ROOT / "scenarios" / "demand" / f"{dataset.name}.json"
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(_as_text(profile), encoding="utf-8")


def _as_text(profile: DemandProfile) -> str:
    """JSON with a line for each road, so that a change can be read."""
    lines = []
    for name, value in profile.model_dump(mode="json").items():
        if isinstance(value, dict):
            rows = ",\n".join(f"  {json.dumps(k)}: {json.dumps(v)}" for k, v in value.items())
            lines.append(f" {json.dumps(name)}: {{\n{rows}\n }}" if value else f' "{name}": {{}}')
        else:
            lines.append(f" {json.dumps(name)}: {json.dumps(value)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def main() -> None:
    """Build all cities and profiles."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--shared", type=Path, default=Path("../shared"))
    options = parser.parse_args()
    for city in sorted({dataset.city for dataset in DATASETS}):
        build_city(city)
    for dataset in DATASETS:
        build_profile(dataset, options.shared)


if __name__ == "__main__":
    main()
