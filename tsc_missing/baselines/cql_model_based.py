"""Conservative Q-learning on logs with holes, with a learned reward model.

The offline form of SDQN-SDQN (model-based) of Mei et al., "Reinforcement learning approaches for
traffic signal control under missing data" (MissLight), IJCAI 2023, with CQL for DQN, as the
DiffLight paper has it:

1. states with holes are filled by store-and-forward (k = 12), as they are when it decides;
2. a reward model r̂(s, a) learns the reward from the steps where it is known (all slots of the
   intersection reported at the step's end) and the state is its own (they did at its start), by
   huber(r̂(s, a) − r);
3. CQL learns from all steps, with r̂ where the reward is not known.

On a complete log it is CQL, after a reward model that nothing asks.
"""

import torch
from torch import Tensor
from torch.nn import functional

from tsc_missing.baselines.base import descend, of_phase, optimiser_of
from tsc_missing.baselines.config import CQLModelBasedSettings
from tsc_missing.baselines.cql import CQL
from tsc_missing.baselines.transitions import Steps
from tsc_missing.qlearning.networks import PhaseValue


class CQLModelBased(CQL):
    """``reward_steps`` updates of the reward model, then CQL."""

    takes_holes = True

    def __init__(self, settings: CQLModelBasedSettings) -> None:
        """Fresh weights from torch's global generator."""
        super().__init__(settings)
        self._reward_steps = settings.reward_steps
        self.reward_model = PhaseValue(settings.width)
        optimiser = optimiser_of([self.reward_model], settings.learning_rate)
        self.optimisers = {**self.optimisers, "reward": optimiser}

    def update(self, batch: Steps, step: int, generator: torch.Generator) -> dict[str, float]:
        """The reward model's first, then those of CQL."""
        if step < self._reward_steps:
            return {**dict.fromkeys(_OF_CQL, torch.nan), "reward_loss": self._learn_reward(batch)}
        return {**super().update(batch, step, generator), "reward_loss": torch.nan}

    def held_out(self, batch: Steps, generator: torch.Generator) -> dict[str, float]:
        """As CQL, and the mean absolute error of the reward model [scaled rewards]."""
        error = (self._modelled(batch) - batch.reward[:, 0]).abs()[_usable(batch)]
        return {**super().held_out(batch, generator), "reward_error": error.mean().item()}

    def reward(self, batch: Steps) -> Tensor:
        """(B, N): of the first step, the model's where it is not known."""
        with torch.no_grad():
            return torch.where(batch.known[:, 1], batch.reward[:, 0], self._modelled(batch))

    def _modelled(self, batch: Steps) -> Tensor:
        values = self.reward_model(batch.features[:, 0], batch.graph)
        return of_phase(values, batch.phase[:, 0])

    def _learn_reward(self, batch: Steps) -> float:
        usable = _usable(batch)
        if not usable.any():
            return torch.nan
        modelled, reward = self._modelled(batch)[usable], batch.reward[:, 0][usable]
        loss = functional.smooth_l1_loss(modelled, reward)
        descend(self.optimisers["reward"], loss, self._settings.gradient_norm)
        return loss.item()


_OF_CQL = ("loss", "td_loss", "conservative", "value")  # what ``CQL.update`` logs


def _usable(batch: Steps) -> Tensor:
    """(B, N) bool: state and reward of the first step are observed."""
    return batch.known[:, 0] & batch.known[:, 1]
