"""Where ``tsc-net`` writes networks, and what it says about them."""

import re
from pathlib import Path

from rich.console import Console

from tsc_missing.config import RunSettings
from tsc_missing.errors import UserError
from tsc_missing.network.folder import Manifest, bundled_cities, canonical
from tsc_missing.paths import user_networks
from tsc_missing.words import counted

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


def find_target(as_name: str | None, out: Path | None) -> tuple[Path, str, str]:
    """The folder to write, the network's name, and the option that said so."""
    if (as_name is None) == (out is None):
        raise UserError("--as", as_name, "give either --as NAME or --out DIR")
    if out is not None:
        return out, out.resolve().name, "--out"
    assert as_name is not None
    if not NAME.fullmatch(as_name):
        raise UserError("--as", as_name, "letters, digits, '_', '.', '-', no '/' in it")
    if as_name in bundled_cities():
        dataset = canonical(as_name)
        raise UserError("--as", as_name, f"that always means the bundled {dataset}; another name")
    return user_networks() / as_name, as_name, "--as"


def say_written(manifest: Manifest, target: Path) -> None:
    """Print what was written where, and what a user should know of it."""
    vehicles = f", {counted(manifest.vehicles, 'vehicle')}" if manifest.vehicles is not None else ""
    intersections = counted(manifest.intersections, "intersection")
    console = Console(highlight=False, soft_wrap=True)
    console.print(f"{manifest.name}: {intersections}{vehicles}", markup=False)
    for note in manifest.notes or ():
        console.print(note if note.startswith("warning: ") else f"note: {note}", markup=False)
    horizon = manifest.horizon
    if horizon is not None and horizon != RunSettings().horizon:
        console.print(
            f"its demand lasts {horizon:g} s: tsc-run --horizon {horizon:g}", markup=False
        )
    console.print(f"written to {target}", markup=False)
