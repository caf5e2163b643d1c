"""The RESCO networks, imported as they are, under the project's controllers.

    python -m tools.resco --out docs/results/resco.md

The networks ship in PyPI's ``sumo-rl``. ``as-built`` is the program that came with each network.
A finished run is kept in ``--keep FOLDER`` with what it was made of, and not run again unless that
is another one now: its settings, files (network, demand, weights) or versions.
"""

import argparse
import importlib.util
import json
import shlex
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tools.runs import run_all
from tsc_missing.config import DiffusionSettings, MissingSettings, RunSettings
from tsc_missing.evaluation.metrics import Result
from tsc_missing.evaluation.run import checksums
from tsc_missing.evaluation.scenario import find_scenario
from tsc_missing.files import replace_file
from tsc_missing.network.folder import Manifest, builder_versions, read_folder
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
CONTROLLERS = (
    "fixed-time",
    "max-queue",
    "max-pressure",
    "advanced-max-pressure",
    "rolling-horizon",
    "difflight",
)
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
    """Import a network with its demand, once with these versions."""
    folder = scratch / name
    if folder.exists() and read_folder(folder, name).manifest.versions != builder_versions():
        shutil.rmtree(folder)
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
    """All results; each is written to ``keep`` as it ends.

    One that is there is read, if it was made of what it would be made of now, and else replaced.
    """
    results = {}
    for start in range(0, len(cells), workers):
        missing = []
        for name, row, settings in cells[start : start + workers]:
            path, made_of = _kept(keep, name, row), ingredients(settings)
            if (result := _read(path, made_of)) is None:
                missing.append((name, row, settings))
            else:
                results[name, *row] = result
        done = run_all([settings for _, _, settings in missing], workers) if missing else []
        for (name, row, settings), result in zip(missing, done, strict=True):
            content = {**ingredients(settings), "result": result.model_dump(mode="json")}
            replace_file(_kept(keep, name, row), json.dumps(content, indent=1).encode())
            results[name, *row] = result
    return results


def ingredients(settings: RunSettings) -> dict[str, Any]:
    """What a result depends on, as JSON values: settings, the files that are read, versions."""
    scenario = find_scenario(settings.net, settings.demand)
    return {
        "settings": settings.model_dump(mode="json", exclude={"net"}),  # a path; see the checksums
        "checksums": checksums(settings, scenario),
        "versions": versions(),
    }


def _kept(keep: Path, name: str, row: tuple[str, str]) -> Path:
    case, controller = row
    return keep / f"{name}-{controller}-{case.replace(' ', '').replace('%', '')}.json"


def _read(path: Path, made_of: dict[str, Any]) -> Result | None:
    """The result of a file, if it is there and was made of that."""
    if not path.is_file():
        return None
    content = json.loads(path.read_text(encoding="utf-8"))
    found = content.pop("result", None)
    return Result.model_validate(found) if content == made_of else None


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


def head(arguments: Sequence[str]) -> list[str]:
    """Markdown: what the table is, and the ``arguments`` of the command that made it."""
    return [
        "# RESCO networks",
        "",
        f"Made by `{shlex.join(['python', '-m', 'tools.resco', *arguments])}` with SUMO "
        f"{versions()['libsumo']}: each network with its own demand, vehicle types and times, seed "
        "0, `att_all` in s (waiting to enter included); what teleported, collided or never entered "
        "stands in brackets. `as-built` is the program that came with the network, and with "
        "`fixed-time`, which is timed for the very demand, needs no sensors. One run a cell.",
        "",
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
    text = "\n".join([*head(sys.argv[1:]), *table(options.networks, wanted, results), ""])
    text += "\n".join(["", *scenario_lines(manifests), ""])
    if options.out is None:
        print(text)
    else:
        options.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
