"""What a training was begun with, by checksum: to go on with something else would mix two."""

import json
from collections.abc import Mapping
from pathlib import Path

from tsc_missing.errors import UserError
from tsc_missing.files import read_json, replace_file

INPUTS = "inputs.json"


def write_inputs(folder: Path, inputs: Mapping[str, str]) -> None:
    """Write what a training reads, name to SHA-256, into its folder."""
    replace_file(folder / INPUTS, (json.dumps(dict(inputs), indent=1) + "\n").encode())


def check_inputs(folder: Path, inputs: Mapping[str, str], field: str = "resume") -> None:
    """Raise ``UserError`` if a training that is to go on was begun with other ``inputs``.

    ``field`` is what named the folder. One that did not write them down, by an earlier version,
    passes.
    """
    if not (folder / INPUTS).is_file():
        return
    before = read_json(folder / INPUTS, field)
    for name in sorted({*inputs, *before}):
        if inputs.get(name) != before.get(name):
            raise UserError(field, folder, f"{name} has changed since it was begun")


def of_scenarios(sources: Mapping[str, Mapping[str, str]]) -> dict[str, str]:
    """The files of scenarios, by the name of the scenario's network, as inputs."""
    return {
        f"{net}/{file}": checksum
        for net, files in sources.items()
        for file, checksum in files.items()
    }
