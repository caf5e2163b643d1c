"""The imputers by name."""

from collections.abc import Callable

from tsc_missing.config import DiffusionSettings
from tsc_missing.errors import UserError, nearest
from tsc_missing.imputation.base import Imputer
from tsc_missing.imputation.diffusion import DiffusionImputer
from tsc_missing.imputation.historical_mean import HistoricalMean
from tsc_missing.imputation.last_value import LastValue
from tsc_missing.imputation.own import FIELD, OwnImputer
from tsc_missing.imputation.store_and_forward import StoreAndForward
from tsc_missing.own_code import is_own, own_class
from tsc_missing.weights.find import find_weights

IMPUTERS: dict[str, Callable[[], Imputer]] = {
    "sfm": StoreAndForward,
    "sfm-4": lambda: StoreAndForward(k=4),
    "last": LastValue,
    "mean": HistoricalMean,
}


DIFFUSION = "diffusion"  # apart from the others: it needs weights


def require_imputer(name: str) -> None:
    """Raise ``UserError`` with the nearest name where there is none of this name."""
    if is_own(name):
        own_class(name, FIELD, Imputer)
    elif name != DIFFUSION and name not in IMPUTERS:
        raise UserError(FIELD, name, nearest(name, [*IMPUTERS, DIFFUSION]))


def make_imputer(name: str, diffusion: DiffusionSettings | None = None) -> Imputer:
    """A new imputer by its name; ``UserError`` names the nearest where there is none."""
    if name == DIFFUSION:
        settings = diffusion or DiffusionSettings()
        return DiffusionImputer(find_weights(settings.weights), *settings.reverse_steps(False))
    require_imputer(name)
    return OwnImputer(name) if is_own(name) else IMPUTERS[name]()
