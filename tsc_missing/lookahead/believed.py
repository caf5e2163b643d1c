"""What a run with missing data would have believed at the steps of an episode.

The returns of phases were found out in the simulator, with the truth; who decides with holes in
what is seen should learn what is best given what the diffusion model makes of it. That holds with
the holes that the episode was played with. With others, what ran gives away what was seen, so only
holes that are soon over do little harm.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from tsc_missing.controllers.planner import Planner
from tsc_missing.lookahead.config import LookaheadSettings
from tsc_missing.lookahead.episode import Played
from tsc_missing.lookahead.masks import besides
from tsc_missing.network.model import BoolArray, Network
from tsc_missing.offline.fill import replay, replay_context
from tsc_missing.offline.log import red_steps_of
from tsc_missing.weights.file import read_tensors, write_tensors
from tsc_missing.weights.find import find_weights

KIND = "lookahead-believed"


@dataclass(frozen=True)
class Belief:
    """The last C observations at the S tried steps of an episode, without holes."""

    values: Tensor  # (S, C, N, 12, F) [vehicles]
    known: Tensor  # (S, C, N, 12) bool, what was observed


def write_beliefs(
    path: Path, settings: LookaheadSettings, network: Network, played: Played, number: int
) -> None:
    """Write what is believed at the tried steps of episode ``number``, whole or not at all."""
    planner = Planner(find_weights(settings.fill), settings.sampling_steps, guided=False)
    tensors: dict[str, Tensor] = {}
    masks = [] if played.mask.all() else [played.mask]
    masks += besides(settings, network, len(played.phase), number)
    for place, mask in enumerate(masks):
        belief = _believed(planner, network, played, mask, seed=place)
        tensors |= {f"values_{place}": belief.values, f"known_{place}": belief.known}
    write_tensors(path, KIND, tensors, {"weights": planner.manifest["checksum"]})


def read_beliefs(path: Path) -> list[Belief]:
    """Those of an episode, one for each of its masks; ``UserError`` if the file holds none."""
    _, tensors = read_tensors(path, KIND)
    count = len(tensors) // 2
    return [Belief(tensors[f"values_{k}"].float(), tensors[f"known_{k}"]) for k in range(count)]


def _believed(
    planner: Planner, network: Network, played: Played, mask: BoolArray, seed: int
) -> Belief:
    """At the tried steps; values in half precision."""
    if not len(played.steps):
        nothing = (0, planner.model.config.history, *played.values.shape[1:])
        return Belief(torch.zeros(nothing).half(), torch.zeros(nothing[:-1], dtype=torch.bool))
    planner.reset(replay_context(network, mask, seed))
    values, known = [], []
    red_steps = red_steps_of(network, played.phase)
    for seen in replay(played.values, played.phase, red_steps, mask):
        if seen.step not in played.steps:
            planner.watch(seen)
            continue
        planned = planner.plan(seen)
        values.append(planned.samples[0].swapaxes(0, 1).astype(np.float16))
        known.append(planned.known.swapaxes(0, 1))
    return Belief(torch.from_numpy(np.stack(values)), torch.from_numpy(np.stack(known)))
