"""Where the bundled networks and scenarios and the user's own networks lie."""

from pathlib import Path

import platformdirs

PACKAGE = Path(__file__).resolve().parent


def bundled(name: str) -> Path:
    """The bundled top-level folder ``name``: inside an installed wheel, or in the checkout."""
    installed = PACKAGE / "_bundled" / name
    return installed if installed.is_dir() else PACKAGE.parent / name


def user_networks() -> Path:
    """The folder of imported networks in the user's data folder."""
    return Path(platformdirs.user_data_dir("tsc-missing")) / "networks"


def bundled_trainings() -> list[str]:
    """The names of the training configs that come with the package."""
    return sorted(path.stem for path in (bundled("scenarios") / "training").glob("*.toml"))
