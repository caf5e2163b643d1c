"""From what a user calls them to the file of the weights."""

from pathlib import Path

from tsc_missing.errors import UserError, nearest
from tsc_missing.paths import bundled_trainings

FOLDER = Path(__file__).resolve().parent
FILE = "weights.safetensors"
FIELD = "weights"
DEFAULT = "universal"
COMMAND = f"tsc-train {DEFAULT}"  # makes the default weights
MAKES_VALUES = "tsc-train lookahead"


def packaged_weights() -> list[str]:
    """The names of the weights that come with the package."""
    return sorted(path.parent.name for path in FOLDER.glob(f"*/{FILE}"))


def find_weights(name: str, command: str = COMMAND, field: str = FIELD) -> Path:
    """The file of the packaged weights ``name``, or of those at the path ``name``.

    A path is that of a weights file or of a folder with a ``weights.safetensors``; a name may also
    be that of a training in ``runs``. Raises ``UserError`` where there is none of these, which says
    what makes weights of that name, or else the ``command`` that makes some of the kind, and names
    the ``field``.
    """
    packaged = packaged_weights()
    if name in packaged:
        return FOLDER / name / FILE
    for path in (Path(name, FILE), Path(name), Path("runs", f"train-{name}", FILE)):
        if _is_file(path):
            return path
    makes = _command(name)
    if makes:
        raise UserError(field, name, f"`{makes}` makes them", verdict="are not in the package")
    allowed = "allowed: the path of a file, as none come with this installation"
    if packaged:
        allowed = f"{nearest(name, packaged)}, or the path of a file"
    raise UserError(field, name or "nothing", f"{allowed}; `{command}` makes some")


def _command(name: str) -> str | None:
    """What makes weights of that name, if it is known."""
    method, _, log = name.partition("-")
    net, _, pattern = log.rpartition("-")
    if method in ("strict", "paper") and net and pattern in ("random", "kriging"):
        option = "" if method == "strict" else f" --method {method}"
        return f"python -m tools.strict {net} {pattern}{option}"
    return f"tsc-train {name}" if name in bundled_trainings() else None


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # no permission, or too long a name
        return False
