"""Double Q-learning with a slowly moving target network."""

import copy
from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor, nn

from tsc_missing.errors import UserError
from tsc_missing.qlearning.config import QLearningSettings
from tsc_missing.qlearning.networks import Graph, QNetwork, make_q_network
from tsc_missing.qlearning.replay import Transitions
from tsc_missing.qlearning.weights import load_q_network
from tsc_missing.training.diverged import check_finite


class Learner:
    """A Q-network, its target and its optimiser.

    y = r + γ Q'(s', argmax_a Q(s', a)) (double Q-learning, van Hasselt et al., AAAI 2016), where
    Q' is the moving average of Q; the loss is Huber's. The average is what decides in the end.
    """

    def __init__(self, settings: QLearningSettings, graphs: Mapping[str, Graph]) -> None:
        """Fresh weights from torch's global generator."""
        self._settings = settings
        self._graphs = graphs
        self.network: QNetwork = make_q_network(
            settings.algorithm, settings.width, settings.history
        )
        self.target = copy.deepcopy(self.network).requires_grad_(False)
        self.optimiser = torch.optim.Adam(self.network.parameters(), settings.learning_rate)
        self.acting = copy.deepcopy(self.target)  # what plays the next episodes
        self.done = 0  # updates

    def begin_with(self, weights: Path) -> None:
        """Take over weights that see no more; ``UserError`` if they are of another shape.

        What they do not see counts for nothing to begin with.
        """
        network, manifest = load_q_network(weights)
        for name in ("algorithm", "width"):
            if manifest[name] != getattr(self._settings, name):
                raise UserError("start", weights, f"its {name} is {manifest[name]}")
        if network.history > self._settings.history:
            raise UserError("start", weights, f"its history is {network.history}")
        state = network.seeing_more(self._settings.history)
        for mine in (self.network, self.target, self.acting):
            mine.load_state_dict(state)

    def act_as_now(self) -> None:
        """Let what is learned so far play the next episodes."""
        self.acting.load_state_dict(self.target.state_dict())

    def update(self, batch: list[Transitions]) -> float:
        """One step of the optimiser; returns the loss. Raises ``DivergedError``."""
        rate = self._settings.rate(self.done / self._settings.all_updates)
        for group in self.optimiser.param_groups:
            group["lr"] = rate
        self.optimiser.zero_grad(set_to_none=True)
        errors = torch.cat([self._errors(transitions) for transitions in batch])
        loss = nn.functional.smooth_l1_loss(errors, torch.zeros_like(errors))
        check_finite(loss, self.done)
        loss.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(self.network.parameters(), self._settings.gradient_norm)
        self.optimiser.step()
        with torch.no_grad():
            for slow, fast in zip(self.target.parameters(), self.network.parameters(), strict=True):
                slow.lerp_(fast, self._settings.target_rate)
        self.done += 1
        return float(loss.item())

    def _errors(self, transitions: Transitions) -> Tensor:
        """(B * N,): temporal differences."""
        graph = self._graphs[transitions.net]
        with torch.no_grad():
            best = self.network(transitions.after, graph).argmax(dim=-1, keepdim=True)
            later = self.target(transitions.after, graph).gather(-1, best).squeeze(-1)
            wanted = transitions.reward + self._settings.discount * later
        values = self.network(transitions.before, graph)
        chosen = values.gather(-1, transitions.phase.unsqueeze(-1)).squeeze(-1)
        errors: Tensor = (chosen - wanted).flatten()
        return errors
