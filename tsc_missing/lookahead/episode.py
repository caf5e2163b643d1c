"""Episodes in which phases are tried: played once, kept as a file, read as what to learn from."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from tsc_missing.config import RunSettings
from tsc_missing.errors import UserError
from tsc_missing.evaluation.closed_loop import run_closed_loop
from tsc_missing.evaluation.scenario import find_scenario
from tsc_missing.lookahead.config import LookaheadSettings
from tsc_missing.lookahead.rollouts import Lookahead
from tsc_missing.network.model import Network
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.offline.log import red_steps_of
from tsc_missing.offline.policies import Exploring
from tsc_missing.qlearning.controller import QPolicy
from tsc_missing.qlearning.features import SlotTables, log_features
from tsc_missing.qlearning.weights import load_q_network
from tsc_missing.seeding import stream
from tsc_missing.weights.file import read_tensors, write_tensors
from tsc_missing.weights.find import find_weights

KIND = "lookahead-episode"


@dataclass(frozen=True)
class Labelled:
    """S decision steps of the N intersections of a network, and what their phases would lead to."""

    net: str
    features: Tensor  # (S, N, 12, ·)
    returns: Tensor  # (S, N, P), NaN without the phase


def draw_run(settings: LookaheadSettings, number: int, scaled: bool) -> tuple[RunSettings, float]:
    """The run of episode ``number`` and its share of random decisions.

    ``scaled``: the demand of its network can be scaled.
    """
    rng = stream(settings.seed, f"episode-{number}")
    volume = round(float(rng.uniform(settings.volume_min, settings.volume_max)), 4)
    run = RunSettings(
        net=settings.nets[number % len(settings.nets)],
        demand=settings.demand,
        volume=volume if scaled else 1.0,
        horizon=settings.horizon,
        seed=int(rng.integers(2**31)),
    )
    return run, float(rng.uniform(settings.epsilon_min, settings.epsilon_max))


def play_labelled(settings: LookaheadSettings, number: int, path: Path) -> None:
    """Play an episode and write its file, whole or not at all."""
    torch.set_num_threads(1)
    scenario = find_scenario(settings.nets[number % len(settings.nets)], settings.demand)
    run, epsilon = draw_run(settings, number, scenario.demand_kind == "profile")
    network = scenario.folder.network
    q, _ = load_q_network(find_weights(settings.base))
    policy = Exploring(QPolicy(q, settings.base), epsilon)
    everything = np.ones((run.steps, network.n, N_SLOTS), dtype=bool)
    random = stream(settings.seed, f"tried-{number}")
    with tempfile.TemporaryDirectory(prefix="tsc-") as scratch:
        folder = Path(scratch)
        interval = run.signals.decision_interval
        lookahead = Lookahead(q, network, interval, settings, random, folder)
        scene = scenario.scene(run, everything)
        trace = run_closed_loop(scene, run, policy, folder, explore=lookahead)
    steps = sorted(lookahead.returns)
    returns = np.array([lookahead.returns[step] for step in steps], dtype=np.float32)
    tensors = {
        "values": torch.from_numpy(trace.truth.astype(np.float32)),
        "phase": torch.from_numpy(trace.phase),
        "steps": torch.tensor(steps, dtype=torch.int64),
        "returns": torch.from_numpy(returns.reshape(-1, *network.phase_mask.shape)),
    }
    about = {"net": run.net, "run": run.model_dump(mode="json"), "epsilon": epsilon}
    write_tensors(path, KIND, tensors, about)


def read_labelled(path: Path, network: Network, interval: float, history: int) -> Labelled:
    """An episode as features and returns; ``UserError`` if it is none, or of another network."""
    manifest, tensors = read_tensors(path, KIND)
    values, phase = tensors["values"].numpy(), tensors["phase"].numpy()
    if tensors["returns"].shape[1:] != network.phase_mask.shape:
        raise UserError("nets", manifest["net"], f"it is not the network of the episode {path}")
    red_steps = red_steps_of(network, phase)
    features = log_features(SlotTables.of(network, interval), values, red_steps, history)
    chosen = torch.from_numpy(features)[tensors["steps"]]
    return Labelled(manifest["net"], chosen, tensors["returns"])
