"""``tsc-net``: import networks, look at them."""

import re
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from tsc_missing.cli.common import make_app, run_app
from tsc_missing.cli.net_show import show
from tsc_missing.errors import UserError
from tsc_missing.paths import user_networks

app = make_app("Import networks into folders that tsc-run can use, and look at them.")

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


@app.callback()
def net() -> None:
    """Import networks into folders that tsc-run can use, and look at them."""


@app.command("import")
def import_network(
    roadnet: Annotated[Path, typer.Option(help="CityFlow's road network, a JSON file.")],
    flow: Annotated[
        Path | None, typer.Option(help="CityFlow's flow, a JSON file: the recorded demand.")
    ] = None,
    as_name: Annotated[
        str | None, typer.Option("--as", help="A name to keep it under, for tsc-run --net NAME.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="A new folder to write it to, for tsc-run --net DIR.")
    ] = None,
    horizon: Annotated[int, typer.Option(min=1, help="Keep trips departing before it, s.")] = 3600,
    all_phases: Annotated[
        bool,
        typer.Option(help="Keep every light phase, not only the first that serve all movements."),
    ] = False,
) -> None:
    """Import a CityFlow road network and flow."""
    from tsc_missing.network.importing import import_cityflow

    target, name, field = _target(as_name, out)
    manifest = import_cityflow(roadnet, flow, target, name, horizon, all_phases, field)
    vehicles = f", {manifest.vehicles} vehicles" if manifest.vehicles is not None else ""
    console = Console(highlight=False, soft_wrap=True)
    console.print(f"{name}: {manifest.intersections} intersections{vehicles}", markup=False)
    console.print(f"written to {target}", markup=False)


app.command("show")(show)


def _target(as_name: str | None, out: Path | None) -> tuple[Path, str, str]:
    """The folder to write, the network's name, and the option that said so."""
    if (as_name is None) == (out is None):
        raise UserError("--as", as_name, "give either --as NAME or --out DIR")
    if out is not None:
        return out, out.resolve().name, "--out"
    assert as_name is not None
    if not NAME.fullmatch(as_name):
        raise UserError("--as", as_name, "letters, digits, '_', '.', '-', no '/' in it")
    return user_networks() / as_name, as_name, "--as"


def main() -> None:
    """The entry point of ``tsc-net``."""
    run_app(app, "tsc-net")


if __name__ == "__main__":
    main()
