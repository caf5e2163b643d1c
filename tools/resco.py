"""The RESCO networks, imported as they are, under the project's controllers.

    python -m tools.resco --out docs/results/resco.md

The networks ship in PyPI's ``sumo-rl``. ``as-built`` is the program that came with each network.
A finished run is kept in ``--keep FOLDER`` and not run again.
"""

import argparse
import importlib.util
import json
import tempfile
from collections.abc import Sequence
from pathlib import Path

from tools.runs import run_all
from tsc_missing.config import DiffusionSettings, MissingSettings, RunSettings
from tsc_missing.evaluation.metrics import Result
from tsc_missing.network.folder import Manifest, read_folder
from tsc_missing.network.importing_sumo import SumoImport, import_sumo
from tsc_missing.versions import versions

NETWORKS = (
    "grid4x4",
    "arterial4x4",
    "cologne1",
    "cologne3",
    "cologne8",
    "ingolstadt1",
    "ingolstadt7",
    "ingolstadt21",
)
CONTROLLERS = ("fixed-time", "max-queue", "max-pressure", "advanced-max-pressure", "difflight")
BLIND_TO_SENSORS = ("as-built", "fixed-time", "actuated", "delay_based")
CASES = {
    "none": MissingSettings(),
    "RM 50 %": MissingSettings(pattern="random", rate=0.5),
    "KM 25 %": MissingSettings(pattern="kriging", rate=0.25),
}


def resco_folder() -> Path | None:
    """Where ``sumo-rl`` has the networks, if it is installed."""
    found = importlib.util.find_spec("sumo_rl")
    if found is None or found.origin is None:
        return None
    folder = Path(found.origin).parent / "nets" / "RESCO"
    return folder if folder.is_dir() else None


def import_network(name: str, source: Path, scratch: Path) -> Path:
    """Import a network with its demand, once."""
    folder = scratch / name
    if not folder.exists():
        import_sumo(SumoImport(source / name / f"{name}.sumocfg"), folder, name)
    return folder


def rows(controllers: Sequence[str]) -> list[tuple[str, str]]:
    """The (case, controller) of each row; controllers that use no sensors have one row."""
    found = [("–", "as-built")]
    found += [("–", name) for name in controllers if name in BLIND_TO_SENSORS]
    return found + [
        (case, name) for case in CASES for name in controllers if name not in BLIND_TO_SENSORS
    ]


def settings_for(folder: Path, row: tuple[str, str], weights: str) -> RunSettings:
    """The run of a row on a network."""
    case, controller = row
    manifest = read_folder(folder, folder.name).manifest
    return RunSettings(
        net=str(folder),
        controller=controller,
        missing=CASES.get(case, MissingSettings()),
        horizon=int(manifest.horizon or 3600),
        diffusion=DiffusionSettings(weights=weights),
    )


def run_cells(
    cells: Sequence[tuple[str, tuple[str, str], RunSettings]], keep: Path, workers: int
) -> dict[tuple[str, str, str], Result]:
    """All results; each is written to ``keep`` as it ends, and read from there if it is there."""
    results = {}
    for start in range(0, len(cells), workers):
        part = cells[start : start + workers]
        missing = [cell for cell in part if not _kept(keep, cell).is_file()]
        for cell, result in zip(missing, run_all([c[2] for c in missing], workers), strict=True):
            temporary = _kept(keep, cell).with_suffix(".part")
            temporary.write_text(result.model_dump_json(), encoding="utf-8")
            temporary.replace(_kept(keep, cell))
        for name, row, settings in part:
            text = _kept(keep, (name, row, settings)).read_text(encoding="utf-8")
            results[name, *row] = Result.model_validate(json.loads(text))
    return results


def _kept(keep: Path, cell: tuple[str, tuple[str, str], RunSettings]) -> Path:
    name, (case, controller), _ = cell
    return keep / f"{name}-{controller}-{case.replace(' ', '').replace('%', '')}.json"


def table(
    names: Sequence[str],
    wanted: Sequence[tuple[str, str]],
    results: dict[tuple[str, str, str], Result],
) -> list[str]:
    """Markdown: a row a case and controller, a column a network."""
    lines = [
        f"| missing | controller | {' | '.join(names)} |",
        f"| --- | --- |{' ---: |' * len(names)}",
    ]
    for row in wanted:
        cells = [_cell(results[name, *row]) for name in names]
        lines.append(f"| {row[0]} | {row[1]} | {' | '.join(cells)} |")
    return lines


def _cell(result: Result) -> str:
    odd = [
        f"{count} {what}"
        for count, what in (
            (result.teleports, "teleported"),
            (result.collisions, "collisions"),
            (result.never_inserted, "never entered"),
        )
        if count
    ]
    odd += ["gridlock"] if result.gridlock else []
    return " ".join([f"{result.att_all:.1f}", *([f"({', '.join(odd)})"] if odd else [])])


def scenario_lines(manifests: dict[str, Manifest]) -> list[str]:
    """A line for each network: size, times, and what the import noted."""
    return [
        f"- **{name}**: {m.intersections} intersections, {m.vehicles} vehicles, "
        f"{m.begin or 0:g} s to {(m.begin or 0) + (m.horizon or 0):g} s"
        + (f"; {'; '.join(m.notes)}" if m.notes else "")
        for name, m in manifests.items()
    ]


def main() -> None:
    """Import and run everything, and print or write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path)
    parser.add_argument("--networks", nargs="+", choices=NETWORKS, default=list(NETWORKS))
    parser.add_argument("--controllers", nargs="+", default=list(CONTROLLERS))
    parser.add_argument("--weights", default=DiffusionSettings().weights, help="for difflight")
    parser.add_argument("--keep", type=Path, help="folder of networks and finished runs")
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    source = resco_folder()
    if source is None:
        parser.error("sumo-rl is not installed; pip install sumo-rl brings the networks")
    with tempfile.TemporaryDirectory() as scratch:
        keep = options.keep or Path(scratch)
        keep.mkdir(parents=True, exist_ok=True)
        folders = {name: import_network(name, source, keep) for name in options.networks}
        wanted = rows(options.controllers)
        cells = [
            (name, row, settings_for(folder, row, options.weights))
            for name, folder in folders.items()
            for row in wanted
        ]
        results = run_cells(cells, keep, options.workers)
        manifests = {name: read_folder(folder, name).manifest for name, folder in folders.items()}
    head = [
        "# RESCO networks",
        "",
        f"Made by `python -m tools.resco --out docs/results/resco.md` with SUMO "
        f"{versions()['libsumo']}: each network with its own demand, vehicle types and times, seed "
        "0, `att_all` in s (waiting to enter included); what teleported, collided or never entered "
        "stands in brackets. `as-built` is the program that came with the network, and with "
        "`fixed-time`, which is timed for the very demand, needs no sensors. One run a cell.",
        "",
    ]
    text = "\n".join([*head, *table(options.networks, wanted, results), ""])
    text += "\n".join(["", *scenario_lines(manifests), ""])
    if options.out is None:
        print(text)
    else:
        options.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
