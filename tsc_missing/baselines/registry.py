"""The baselines' learners by name."""

from collections.abc import Callable
from typing import Any

from tsc_missing.baselines.base import Learner
from tsc_missing.baselines.bc import BC
from tsc_missing.baselines.config import BaselineSettings

LEARNERS: dict[str, Callable[[Any], Learner]] = {
    "bc": BC,
}


def make_learner(settings: BaselineSettings) -> Learner:
    """The learner of these settings, with fresh weights from torch's global generator."""
    return LEARNERS[settings.algorithm](settings)
