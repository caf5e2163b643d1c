"""What decisions could gain at most: in every step the phases that the simulator itself finds best.

    python -m tools.lookahead jinan_1 --seed 1000

At each decision step all phases are tried (`tsc_missing.lookahead`), with the traffic that is to
come, and the best run. No controller can do that: it is a bound, of one step of improvement on the
weights that decide afterwards. Prints the average travel time beside that of the weights alone.
Takes some minutes.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
import torch

from tsc_missing.config import RunSettings
from tsc_missing.controllers.base import ControlContext, Controller
from tsc_missing.evaluation.closed_loop import Explore, Progress, run_closed_loop
from tsc_missing.evaluation.scenario import find_scenario
from tsc_missing.lookahead.config import LookaheadSettings
from tsc_missing.lookahead.rollouts import Lookahead
from tsc_missing.network.model import IntArray
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.qlearning.controller import QPolicy
from tsc_missing.qlearning.weights import load_q_network
from tsc_missing.sensing.observation import Observation
from tsc_missing.weights.find import find_weights


class Foresighted(Controller):
    """Runs what a lookahead found best in the same step."""

    def __init__(self, lookahead: Lookahead) -> None:
        """The lookahead must try phases at every step."""
        self._lookahead = lookahead

    def reset(self, context: ControlContext) -> None:
        """Nothing to forget."""

    def decide(self, observation: Observation) -> IntArray:
        """(N,): the phases with the highest returns."""
        returns = self._lookahead.returns[observation.step]
        return np.asarray(np.nanargmax(returns, axis=1))


def att(run: RunSettings, weights: str, settings: LookaheadSettings | None) -> float:
    """The average travel time [s] of a run, with foresight if ``settings`` are given."""
    scenario = find_scenario(run.net, run.demand)
    network = scenario.folder.network
    scene = scenario.scene(run, np.ones((run.steps, network.n, N_SLOTS), dtype=bool))
    q, _ = load_q_network(find_weights(weights))
    policy: Controller = QPolicy(q, weights)
    explore: Explore | None = None
    seen: list[Progress] = []
    with tempfile.TemporaryDirectory(prefix="tsc-") as scratch:
        folder = Path(scratch)
        if settings is not None:
            interval, random = run.signals.decision_interval, np.random.default_rng(0)
            explore = lookahead = Lookahead(q, network, interval, settings, random, folder)
            policy = Foresighted(lookahead)
        run_closed_loop(scene, run, policy, folder, watch=seen.append, explore=explore)
    return seen[-1].att


def main() -> None:
    """Print both."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("net")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--weights", default="value", help="that decide after the tried step")
    parser.add_argument("--depth", type=int, default=4, help="decision steps simulated ahead")
    parser.add_argument("--horizon", type=int, default=3600, help="seconds")
    wanted = parser.parse_args()
    torch.set_num_threads(1)
    run = RunSettings(net=wanted.net, seed=wanted.seed, horizon=wanted.horizon)
    settings = LookaheadSettings(nets=(wanted.net,), tried=1.0, depth=wanted.depth)
    for words, found in (
        (f"{wanted.weights}", att(run, wanted.weights, None)),
        (f"{wanted.weights} and foresight", att(run, wanted.weights, settings)),
    ):
        print(f"{wanted.net}, seed {wanted.seed}: {words}: {found:.1f} s", flush=True)


if __name__ == "__main__":
    main()
