"""Q-networks with shared weights over intersections, for any number of them and any phases.

All score a phase through the slots that it serves, so that another phase table needs no other
weights. Where the published networks have a fixed order of four phases, this replaces it.
"""

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from tsc_missing.network.model import Network
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.qlearning.features import CERTAINTY, NAMES, PAST, columns, names_with

GREEN, THERE = NAMES.index("green"), NAMES.index("there")
NO_PHASE = -1e9  # the value of a phase that the intersection does not have


@dataclass(frozen=True)
class Graph:
    """What the networks need of a network of N intersections."""

    phases: Tensor  # (N, P, 12) bool
    phase_mask: Tensor  # (N, P) bool
    adjacent: Tensor  # (N, A) the intersection itself and those next to it, -1 for none

    @classmethod
    def of(cls, network: Network) -> "Graph":
        """The graph of a network."""
        rows = [[n, *row.nonzero()[0].tolist()] for n, row in enumerate(network.adjacency)]
        most = max(map(len, rows))
        table = [[*row, *[-1] * (most - len(row))] for row in rows]
        return cls(
            phases=torch.from_numpy(network.phases),
            phase_mask=torch.from_numpy(network.phase_mask),
            adjacent=torch.tensor(table),
        )


class QNetwork(nn.Module, ABC):
    """Values of the phases of all intersections."""

    history = 0  # decision steps before the present that it looks back
    certainty = False  # whether it is told what was seen and what was filled in

    def forward(self, x: Tensor, graph: Graph) -> Tensor:
        """(B, N, P) of features ``x`` (B, N, 12, ·); ``NO_PHASE`` without the phase.

        ``x`` are the features that ``names_with`` names for its ``history`` and ``certainty``.
        """
        return self._values(x, graph).masked_fill(~graph.phase_mask, NO_PHASE)

    def seeing_more(self, history: int, certainty: bool = False) -> dict[str, Tensor]:
        """Its weights for a network that sees as much or more and gives the same values."""
        if (history, certainty) == (self.history, self.certainty):
            return dict(self.state_dict())
        raise ValueError(f"{type(self).__name__} looks back {self.history} decision steps")

    @abstractmethod
    def _values(self, x: Tensor, graph: Graph) -> Tensor:
        """(B, N, P), anything where there is no phase."""


def dense(*widths: int, last: bool = True) -> nn.Sequential:
    """Linear layers with ReLU between them, and after them unless ``last`` is linear."""
    layers: list[nn.Module] = []
    for inputs, outputs in itertools.pairwise(widths):
        layers += [nn.Linear(inputs, outputs), nn.ReLU()]
    return nn.Sequential(*(layers[:-1] if last else layers))


class SlotEmbedding(nn.Module):
    """Chosen features of a slot, and which slot it is, to a vector; zero where it is not there."""

    place: Tensor

    def __init__(self, names: Sequence[str], width: int, among: Sequence[str] = NAMES) -> None:
        """``names`` of ``qlearning.features``, ``among`` all that there are."""
        super().__init__()
        self.columns = columns(names, among)
        self.width = width
        self.register_buffer("place", torch.eye(N_SLOTS), persistent=False)
        self.layers = dense(len(self.columns) + N_SLOTS, 2 * width, width, last=False)

    def forward(self, x: Tensor) -> Tensor:
        """(…, 12, ·) to (…, 12, D)."""
        place = self.place.expand(*x.shape[:-1], N_SLOTS)
        e: Tensor = self.layers(torch.cat((x[..., self.columns], place), dim=-1))
        return e * x[..., THERE : THERE + 1]


def served(graph: Graph, e: Tensor) -> Tensor:
    """(B, N, P, D): the sum of ``e`` (B, N, 12, D) over the slots of each phase."""
    return graph.phases.float() @ e


def running_phase(graph: Graph, x: Tensor) -> Tensor:
    """(B, N, P, 1): the share of a phase's slots that have green now."""
    phases = graph.phases.float()
    count = phases.sum(dim=-1, keepdim=True).clamp(min=1)
    share: Tensor = phases @ x[..., GREEN : GREEN + 1] / count
    return share


class CoLight(QNetwork):
    """CoLight (Wei et al., CIKM 2019): attention over the intersection itself and its neighbours.

    With the features "pressure" it is Efficient-CoLight (Wu et al., arXiv 2112.02336), with
    "pressure" and "effective_running" Advanced-CoLight (Zhang et al., ICML 2022, arXiv
    2112.10107); all know what is green.
    """

    def __init__(self, names: tuple[str, ...], width: int, heads: int = 4) -> None:
        """``width`` is a multiple of ``heads``."""
        super().__init__()
        self.heads = heads
        self.slot = SlotEmbedding(("green", *names), width)
        self.intersection = dense(width, width, last=False)
        self.query, self.key, self.value = (nn.Linear(width, width) for _ in range(3))
        self.score = dense(2 * width + 1, width, 1)

    def _values(self, x: Tensor, graph: Graph) -> Tensor:
        e = self.slot(x)
        around = self._attend(self.intersection(e.sum(dim=2)), graph.adjacent)
        around = around.unsqueeze(2).expand(-1, -1, graph.phases.shape[1], -1)
        by_phase = torch.cat((served(graph, e), around, running_phase(graph, x)), dim=-1)
        values: Tensor = self.score(by_phase).squeeze(-1)
        return values

    def _attend(self, h: Tensor, adjacent: Tensor) -> Tensor:
        """(B, N, D) of ``h`` (B, N, D): multi-head attention of each to those beside it."""
        batch, n, width = h.shape
        near = h[:, adjacent.clamp(min=0)]  # (B, N, A, D)
        q = self.query(h).view(batch, n, self.heads, 1, -1)
        k, v = (
            layer(near).view(batch, n, -1, self.heads, width // self.heads).transpose(2, 3)
            for layer in (self.key, self.value)
        )
        logits = (q @ k.transpose(-1, -2)) * (width // self.heads) ** -0.5
        logits = logits.masked_fill((adjacent < 0)[:, None, None], -torch.inf)
        found: Tensor = (logits.softmax(dim=-1) @ v).view(batch, n, width)
        return torch.relu(found)


class AttendLight(QNetwork):
    """AttendLight (Oroojlooy et al., NeurIPS 2020): attention within phases, and over them.

    A phase is its slots by attention with their mean as the query; phases then attend to each
    other, where the published one has a recurrent network over them. Learned here by Q-learning,
    where the published one is learned by policy gradient.
    """

    def __init__(self, width: int) -> None:
        """Queues and running vehicles of the slots and of the roads that they lead to."""
        super().__init__()
        names = ("green", "queue", "running", "downstream_queue", "downstream_running")
        self.slot = SlotEmbedding(names, width)
        self.state = nn.MultiheadAttention(width, 1, batch_first=True)
        self.action = nn.MultiheadAttention(width, 1, batch_first=True)
        self.score = dense(2 * width + 1, width, 1)

    def _values(self, x: Tensor, graph: Graph) -> Tensor:
        e = self.slot(x)
        batch, n, _, width = e.shape
        count = graph.phases.shape[1]
        slots = e.unsqueeze(2).expand(-1, -1, count, -1, -1).reshape(-1, N_SLOTS, width)
        in_phase = graph.phases.expand(batch, -1, -1, -1).reshape(-1, N_SLOTS)
        out = ~in_phase & in_phase.any(dim=1, keepdim=True)  # a phase that is not there: all
        mean = (slots * in_phase.unsqueeze(-1)).sum(dim=1, keepdim=True)
        mean = mean / in_phase.sum(dim=1).clamp(min=1)[:, None, None]
        by_phase, _ = self.state(mean, slots, slots, key_padding_mask=out, need_weights=False)
        by_phase = by_phase.view(batch * n, count, width)
        absent = ~graph.phase_mask.expand(batch, -1, -1).reshape(batch * n, count)
        around, _ = self.action(
            by_phase, by_phase, by_phase, key_padding_mask=absent, need_weights=False
        )
        both = torch.cat((by_phase, around), dim=-1).view(batch, n, count, -1)
        values: Tensor = self.score(torch.cat((both, running_phase(graph, x)), dim=-1)).squeeze(-1)
        return values


class PhaseValue(QNetwork):
    """A value for what is known of an intersection, the roads into it and the roads out of it.

    A phase is the sum of its slots, the sum of the other slots and the sum over all phases.
    """

    def __init__(self, width: int, history: int = 0, certainty: bool = False) -> None:
        """All features, those of ``history`` decision steps before, and their ``certainty``."""
        super().__init__()
        self.history = history
        self.certainty = certainty
        names = names_with(history, certainty)
        self.slot = SlotEmbedding(names, width, names)
        self.score = dense(3 * width + 1, 2 * width, width, 1)
        self.level = dense(width, width, 1)

    def seeing_more(self, history: int, certainty: bool = False) -> dict[str, Tensor]:
        """The features that it does not see get weights of zero."""
        if history < self.history or (self.certainty and not certainty):
            raise ValueError(f"it looks back {self.history} steps, certainty: {self.certainty}")
        state = dict(self.state_dict())
        name = "slot.layers.0.weight"
        told = len(CERTAINTY) if self.certainty else 0
        parts = state[name].split((state[name].shape[1] - told - N_SLOTS, told, N_SLOTS), dim=1)
        values, sure, place = parts
        past = values.new_zeros(len(values), len(PAST) * (history - self.history))
        if certainty and not self.certainty:
            sure = values.new_zeros(len(values), len(CERTAINTY))
        return state | {name: torch.cat((values, past, sure, place), dim=1)}

    def _values(self, x: Tensor, graph: Graph) -> Tensor:
        e = self.slot(x)
        mine = served(graph, e)
        total = e.sum(dim=2, keepdim=True)
        any_phase = graph.phases.any(dim=1, keepdim=True).float() @ e
        parts = (mine, total - mine, any_phase.expand_as(mine), running_phase(graph, x))
        values: Tensor = self.score(torch.cat(parts, dim=-1)).squeeze(-1)
        level: Tensor = self.level(total).squeeze(-1)
        return values + level


ALGORITHMS: dict[str, Callable[[int], QNetwork]] = {
    "advanced-colight": lambda width: CoLight(("pressure", "effective_running"), width),
    "attendlight": AttendLight,
    "efficient-colight": lambda width: CoLight(("pressure",), width),
    "value": PhaseValue,
}


def make_q_network(
    algorithm: str, width: int, history: int = 0, certainty: bool = False
) -> QNetwork:
    """Fresh weights from torch's global generator; only ``value`` sees more than the present."""
    if history or certainty:
        return PhaseValue(width, history, certainty)
    return ALGORITHMS[algorithm](width)
