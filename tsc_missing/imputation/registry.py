"""The imputers by name."""

from collections.abc import Callable

from tsc_missing.errors import UserError, nearest
from tsc_missing.imputation.base import Imputer
from tsc_missing.imputation.historical_mean import HistoricalMean
from tsc_missing.imputation.last_value import LastValue
from tsc_missing.imputation.store_and_forward import StoreAndForward

IMPUTERS: dict[str, Callable[[], Imputer]] = {
    "sfm": StoreAndForward,
    "sfm-4": lambda: StoreAndForward(k=4),
    "last": LastValue,
    "mean": HistoricalMean,
}


def make_imputer(name: str) -> Imputer:
    """A new imputer by its name; ``UserError`` names the nearest where there is none."""
    if name not in IMPUTERS:
        raise UserError("imputer", name, nearest(name, IMPUTERS))
    return IMPUTERS[name]()
