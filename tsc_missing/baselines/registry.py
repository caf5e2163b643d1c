"""The baselines' learners by name."""

from collections.abc import Callable
from typing import Any

from tsc_missing.baselines.base import Learner
from tsc_missing.baselines.bc import BC
from tsc_missing.baselines.config import BaselineSettings
from tsc_missing.baselines.cql import CQL
from tsc_missing.baselines.cql_model_based import CQLModelBased
from tsc_missing.baselines.decision_diffuser import DecisionDiffuser
from tsc_missing.baselines.decision_transformer import DecisionTransformer
from tsc_missing.baselines.diffuser import Diffuser
from tsc_missing.baselines.td3_bc import TD3BC

LEARNERS: dict[str, Callable[[Any], Learner]] = {
    "bc": BC,
    "cql": CQL,
    "cql-model-based": CQLModelBased,
    "decision-diffuser": DecisionDiffuser,
    "decision-transformer": DecisionTransformer,
    "diffuser": Diffuser,
    "td3-bc": TD3BC,
}


def make_learner(settings: BaselineSettings) -> Learner:
    """The learner of these settings, with fresh weights from torch's global generator."""
    return LEARNERS[settings.algorithm](settings)
