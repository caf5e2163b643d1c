"""Episodes in which phases are tried: played once, kept as a file."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from tsc_missing.config import DiffusionSettings, RunSettings
from tsc_missing.controllers.base import Controller
from tsc_missing.controllers.difflight import DiffLight
from tsc_missing.controllers.registry import roomy
from tsc_missing.controllers.spillback import Room
from tsc_missing.errors import UserError
from tsc_missing.evaluation.closed_loop import run_closed_loop
from tsc_missing.evaluation.scenario import find_scenario
from tsc_missing.lookahead.config import LookaheadSettings
from tsc_missing.lookahead.masks import played_with
from tsc_missing.lookahead.rollouts import Lookahead
from tsc_missing.network.model import BoolArray, IntArray, Network
from tsc_missing.offline.log import Float32Array
from tsc_missing.offline.policies import Exploring
from tsc_missing.qlearning.controller import QPolicy
from tsc_missing.qlearning.networks import QNetwork
from tsc_missing.qlearning.weights import load_q_network
from tsc_missing.seeding import stream
from tsc_missing.weights.file import read_tensors, write_tensors
from tsc_missing.weights.find import find_weights

KIND = "lookahead-episode"


@dataclass(frozen=True)
class Played:
    """T decision steps of N intersections, and what their phases would lead to at S of them."""

    net: str
    values: Float32Array  # (T, N, 12, F)
    phase: IntArray  # (T, N) that ran
    mask: BoolArray  # (T, N, 12) what the policy saw
    steps: IntArray  # (S,) at which phases were tried
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


def play_episode(settings: LookaheadSettings, number: int, path: Path) -> None:
    """Play an episode and write its file, whole or not at all."""
    torch.set_num_threads(1)
    scenario = find_scenario(settings.nets[number % len(settings.nets)], settings.demand)
    run, epsilon = draw_run(settings, number, scenario.demand_kind == "profile")
    network = scenario.folder.network
    q, _ = load_q_network(find_weights(settings.base))
    mask = played_with(settings, network, run.steps, number)
    policy = Exploring(roomy(_policy(settings, q, mask), settings.min_space), epsilon)
    random = stream(settings.seed, f"tried-{number}")
    with tempfile.TemporaryDirectory(prefix="tsc-") as scratch:
        folder = Path(scratch)
        interval = run.signals.decision_interval
        space = settings.min_space
        room = Room(network, space, run.vehicle.spacing) if space else None
        lookahead = Lookahead(q, network, interval, settings, random, folder, room)
        scene = scenario.scene(run, mask)
        trace = run_closed_loop(scene, run, policy, folder, explore=lookahead)
    steps = sorted(lookahead.returns)
    returns = np.array([lookahead.returns[step] for step in steps], dtype=np.float32)
    tensors = {
        "values": torch.from_numpy(trace.truth.astype(np.float32)),
        "phase": torch.from_numpy(trace.phase),
        "mask": torch.from_numpy(mask),
        "steps": torch.tensor(steps, dtype=torch.int64),
        "returns": torch.from_numpy(returns.reshape(-1, *network.phase_mask.shape)),
    }
    about = {"net": run.net, "run": run.model_dump(mode="json"), "epsilon": epsilon}
    write_tensors(path, KIND, tensors, about)


def read_played(path: Path, network: Network) -> Played:
    """An episode; ``UserError`` if the file holds none, or one of another network."""
    manifest, tensors = read_tensors(path, KIND)
    if tensors["returns"].shape[1:] != network.phase_mask.shape:
        raise UserError("nets", manifest["net"], f"it is not the network of the episode {path}")
    if "mask" not in tensors:  # in those written before there were masks all was seen
        tensors["mask"] = torch.ones(tensors["values"].shape[:-1], dtype=torch.bool)
    arrays = {name: tensors[name].numpy() for name in ("values", "phase", "mask", "steps")}
    return Played(manifest["net"], **arrays, returns=tensors["returns"])


def _policy(settings: LookaheadSettings, q: QNetwork, mask: BoolArray) -> Controller:
    """The base by itself where everything is seen, else behind the diffusion model."""
    if mask.all():
        return QPolicy(q, settings.base)
    fill, base = find_weights(settings.fill), find_weights(settings.base)
    return DiffLight(fill, settings.sampling_steps, "value", [base], DiffusionSettings().samples)
