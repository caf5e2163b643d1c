"""The mask of a run: drawn from its seed, or read from a file."""

import contextlib
import json
from pathlib import Path

import numpy as np

from tsc_missing.config import RunSettings
from tsc_missing.errors import UserError
from tsc_missing.network.model import BoolArray, Network
from tsc_missing.sensing.masks import load_mask
from tsc_missing.sensing.outage_list import is_list, read_outages
from tsc_missing.sensing.patterns import draw_mask, equipped


def mask_of(settings: RunSettings, network: Network) -> BoolArray:
    """(T, N, 12): which slots report at each decision step of a run; true = reported."""
    path = mask_file(settings)
    if path is None:
        return draw_mask(settings.missing, network, settings.steps, settings.seed_of_mask)
    if is_list(path):
        interval = settings.signals.decision_interval
        return read_outages(path, network, settings.steps, interval)
    _check_interval(path, settings.signals.decision_interval)
    return load_mask(path, network, settings.steps)


def sensors_of(settings: RunSettings, network: Network, mask: BoolArray) -> BoolArray:
    """(N, 12): which slots have a sensor; where a file says what is missing, those that report."""
    if mask_file(settings) is None:
        return equipped(settings.missing, network, settings.seed_of_mask)
    return np.asarray(np.any(mask, axis=0))


def _check_interval(path: Path, interval: int) -> None:
    """Raise ``UserError`` for the mask of a run that decided at other times."""
    with contextlib.suppress(OSError, ValueError, LookupError, TypeError):
        record = json.loads(path.with_name("run.json").read_text(encoding="utf-8"))
        found = record["settings"]["signals"]["decision_interval"]
        if found != interval:
            raise UserError("mask", path, f"its steps are of {found} s, the run's of {interval} s")


def mask_file(settings: RunSettings) -> Path | None:
    """The file that says what is missing; None where it is drawn."""
    return Path(settings.missing.file) if settings.missing.file else None
