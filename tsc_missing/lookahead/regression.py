"""From returns of tried phases to a network that expects them."""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace

import torch
from torch import Tensor, nn

from tsc_missing.lookahead.config import LookaheadSettings
from tsc_missing.lookahead.labelled import Labelled
from tsc_missing.network.slots import N_SLOTS, TURNS
from tsc_missing.qlearning.features import names_with
from tsc_missing.qlearning.networks import Graph, PhaseValue
from tsc_missing.seeding import stream
from tsc_missing.training.diverged import check_finite


class Regression:
    """A network that goes on from the base, and learns by how much phases differ.

    The loss is Huber's on A(a) = G(a) - mean_a' G(a'), divided by the mean of |A| in the episode;
    which phase is best does not depend on the mean, and most of the noise is in it. Episodes come
    as often as they have returns, with their approaches in another order each time, some with
    everything observed, the others with what is believed under one of their masks: the returns
    are the same, so what is learned is what a phase is worth given what is believed. A moving
    average of the weights is the result.
    """

    def __init__(
        self,
        settings: LookaheadSettings,
        base: PhaseValue,
        graphs: Mapping[str, Graph],
        episodes: Sequence[Labelled],
    ) -> None:
        """``graphs`` by network."""
        self._settings = settings
        self._base = base
        self._graphs = graphs
        self._episodes = [episode for episode in episodes if len(episode.returns)]
        self._random = stream(settings.seed, "updates")
        counts = torch.tensor([len(e.returns.flatten(0, 1)) for e in self._episodes]).double()
        self._shares = (counts / counts.sum()).numpy()
        sees = settings.history, settings.masked
        self.network = PhaseValue(base.slot.width, *sees)
        self.network.load_state_dict(base.seeing_more(*sees))
        self.average = copy.deepcopy(self.network).requires_grad_(False).eval()
        self._optimiser = torch.optim.AdamW(
            self.network.parameters(), settings.learning_rate, weight_decay=settings.weight_decay
        )
        self._scales = [_size(episode.returns) for episode in self._episodes]
        self._done = 0

    def update(self) -> float:
        """One step of the optimiser, on decision steps of one episode; returns the loss.

        Raises ``DivergedError``.
        """
        settings = self._settings
        for group in self._optimiser.param_groups:
            group["lr"] = settings.learning_rate * (1 - self._done / settings.updates)
        number = self._random.choice(len(self._shares), p=self._shares)
        episode, scale = self._episodes[number], self._scales[number]
        count = max(1, settings.batch // episode.returns.shape[1])
        chosen = torch.from_numpy(self._random.integers(len(episode.returns), size=count))
        returns = episode.returns[chosen]
        variant = self._variant(len(episode.features))
        features, counted = episode.features[variant][chosen], episode.counted[variant][chosen]
        order, graph = self._turned(self._graphs[episode.net])
        values = self.network(features[..., order, :], graph)
        wanted, found = centred(returns), centred(torch.where(returns.isnan(), torch.nan, values))
        there = ~returns.isnan() & counted.unsqueeze(-1)
        loss = nn.functional.smooth_l1_loss(found[there] / scale, wanted[there] / scale)
        check_finite(loss, self._done)
        self._optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        self._optimiser.step()
        with torch.no_grad():
            for slow, fast in zip(
                self.average.parameters(), self.network.parameters(), strict=True
            ):
                slow.lerp_(fast, settings.average)
        self._done += 1
        return float(loss.item())

    def _variant(self, count: int) -> int:
        """Which of ``count`` features of an episode; the first are of everything observed."""
        if count == 1 or self._random.random() < self._settings.complete:
            return 0
        return int(self._random.integers(1, count))

    def _turned(self, graph: Graph) -> tuple[Tensor, Graph]:
        """The slots with the approaches in another order, and the phases with them.

        What a phase leads to does not depend on which approach comes from where.
        """
        approaches = torch.from_numpy(self._random.permutation(N_SLOTS // len(TURNS)))
        order = (approaches[:, None] * len(TURNS) + torch.arange(len(TURNS))).flatten()
        return order, replace(graph, phases=graph.phases[..., order])

    @torch.inference_mode()
    def gained(self, episodes: Sequence[Labelled]) -> dict[str, float]:
        """The part of what the best phases would have gained over the base's that ours gain.

        With everything ``observed`` and, where there are masks, with what is ``believed``; both
        over what the base decides with everything observed. Empty where nothing can be gained.
        """
        most = 0.0
        got = {"observed": 0.0, "believed": 0.0}
        for episode in episodes:
            graph, observed = self._graphs[episode.net], episode.features[0]
            sees = len(names_with(self._base.history, self._base.certainty))
            base = _of_best(self._base(observed[..., :sees], graph), episode.returns)
            best = episode.returns.nan_to_num(-torch.inf).amax(dim=-1)
            most += float((best - base).sum())
            ours = [
                float((_of_best(self.average(seen, graph), episode.returns) - base).sum())
                for seen in episode.features
            ]
            got["observed"] += ours[0]
            got["believed"] += sum(ours[1:]) / max(1, len(ours) - 1)
        masked = any(len(episode.features) > 1 for episode in episodes)
        names = ("observed", "believed") if masked else ("observed",)
        return {name: got[name] / most for name in names} if most else {}


def centred(returns: Tensor) -> Tensor:
    """(…, P): each less the mean of those that are not NaN, which stay so as 0."""
    return (returns - returns.nanmean(dim=-1, keepdim=True)).nan_to_num(0.0)


def _size(returns: Tensor) -> float:
    """The mean of |A|; 1 where no phase differs."""
    sizes = centred(returns).abs()
    there = sizes[sizes > 0]
    return float(there.mean()) if len(there) else 1.0


def _of_best(values: Tensor, returns: Tensor) -> Tensor:
    """(S, N): the return of the phase with the highest value."""
    return returns.gather(-1, values.argmax(dim=-1, keepdim=True)).squeeze(-1)
