"""One run of a policy, as a log."""

import tempfile
from pathlib import Path

import numpy as np

from tsc_missing.config import MissingSettings, RunSettings
from tsc_missing.controllers.base import Controller
from tsc_missing.evaluation.closed_loop import run_closed_loop
from tsc_missing.evaluation.scenario import Scenario
from tsc_missing.network.model import BoolArray
from tsc_missing.network.slots import N_SLOTS
from tsc_missing.offline.log import EpisodeLog, log_of
from tsc_missing.sensing.patterns import draw_mask


def play(
    scenario: Scenario,
    settings: RunSettings,
    policy: Controller,
    holes: MissingSettings | None = None,
    mask_seed: int = 0,
    scratch: Path | None = None,
    seen: BoolArray | None = None,
) -> EpisodeLog:
    """Run the policy on what is ``seen`` (T, N, 12), by default everything.

    The log has the truth; with ``holes`` what is under a mask drawn from ``mask_seed`` is left out
    of it. SUMO's files go below ``scratch`` and are removed.
    """
    network = scenario.folder.network
    if seen is None:
        seen = np.ones((settings.steps, network.n, N_SLOTS), dtype=bool)
    with tempfile.TemporaryDirectory(prefix="tsc-", dir=scratch) as folder:
        trace = run_closed_loop(scenario.scene(settings, seen), settings, policy, Path(folder))
    mask = None
    if holes is not None and holes.pattern != "none":
        mask = draw_mask(holes, network, settings.steps, mask_seed)
    return log_of(trace, network, mask)
