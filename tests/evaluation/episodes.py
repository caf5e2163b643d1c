"""Short runs for the tests of environments."""

from typing import Any

from tsc_missing.config import MissingSettings, RunSettings

HALF = MissingSettings(pattern="random", rate=0.5)


def settings(**changes: Any) -> RunSettings:
    return RunSettings(**{"net": "jinan", "horizon": 300, "missing": HALF, **changes})
