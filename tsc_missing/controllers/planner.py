"""From a stream of observations to plans: what the diffusion controller and imputer share.

Importing this imports torch; ``difflight.load_planner`` does it when a planner is wanted.
"""

from dataclasses import dataclass
from pathlib import Path

import torch

from tsc_missing.controllers.base import ControlContext
from tsc_missing.controllers.recent import RecentSteps
from tsc_missing.diffusion.config import Precision
from tsc_missing.diffusion.history import History
from tsc_missing.diffusion.memory import keep_freed_memory
from tsc_missing.diffusion.pace import Pace
from tsc_missing.diffusion.samples import all_samples, unseen, with_copies
from tsc_missing.diffusion.weights import load_weights
from tsc_missing.errors import UserError
from tsc_missing.network.model import BoolArray, FloatArray, IntArray
from tsc_missing.sensing.observation import Observation

PRECISION: Precision = "bfloat16"  # of the products: half the time of float32
THREADS = 1  # two wait for each other at every small product, seconds long on a busy machine


@dataclass(frozen=True)
class Planned:
    """What the model makes of an observation and those before it."""

    samples: FloatArray  # (M, N, C, 12, F) [vehicles] the last observations without holes
    red_steps: IntArray  # (N, C, 12) with them
    known: BoolArray  # (N, C, 12) whether it was observed
    future: FloatArray  # (N, H, 12, F) [vehicles] planned
    logits: FloatArray  # (N, P) of the phase to run now, -inf without the phase

    @property
    def present(self) -> FloatArray:
        """(N, 12, F) [vehicles]: the newest observation without holes, of the first sample.

        The mean of the samples would be nearer to the truth, but a road that is full in some of
        them is full in no mean.
        """
        present: FloatArray = self.samples[0, :, -1]
        return present


class Planner:
    """A model that remembers the last C observations of a run and plans from them.

    What it generates is not remembered: one bad plan does not spoil the next. Its noise comes
    from the context's seed.
    """

    def __init__(
        self,
        weights: Path,
        sampling_steps: int,
        guided: bool,
        samples: int = 1,
        blind_steps: int | None = None,
    ) -> None:
        """Load the model; not ``guided`` leaves rewards out, for imputation only.

        ``sampling_steps`` reverse steps a decision, at intersections without a sensor
        ``blind_steps`` if there are more of them (None: as many).

        ``samples`` M are generated of intersections of which nothing is known; of all others, and
        where there are none, one.

        Sets the number of threads and the memory settings of the process. Raises ``UserError``
        for weights that cannot be used.
        """
        self.model, self.manifest = load_weights(weights)
        self.model.use(PRECISION)
        most = self.model.config.diffusion_steps
        self._sampling_steps = sampling_steps
        self._blind_steps = min(blind_steps or sampling_steps, most)
        if not 1 <= sampling_steps <= most:
            raise UserError(
                "sampling_steps", sampling_steps, f"with these weights it must be 1 to {most}"
            )
        self._guided = guided
        self._copies = samples - 1
        torch.set_num_threads(THREADS)
        keep_freed_memory()

    def reset(self, context: ControlContext) -> None:
        """Forget everything and get ready for a run on the context's network."""
        network = context.network
        self._recent = RecentSteps(network.n, self.model.config.history)
        self._generator = torch.Generator().manual_seed(context.seed)
        self._observable = torch.from_numpy(context.sensors & network.slot_mask)
        self._slots = torch.from_numpy(network.slot_mask)
        self._neighbours = torch.from_numpy(network.neighbours)
        self._downstream = torch.from_numpy(network.downstream)
        self._phases = torch.from_numpy(network.phases)
        self._phase_mask = torch.from_numpy(network.phase_mask)

    def watch(self, observation: Observation) -> None:
        """Take in the next observation of the run."""
        self._recent.take(observation)

    def plan(self, observation: Observation) -> Planned:
        """Take in the next observation of the run, fill its holes and plan from it."""
        self.watch(observation)
        history = self._history()
        count, rows = len(history.slots), unseen(history)
        noise = [self.model.initial_noise(count, self._generator)]
        if self._copies and len(rows):
            history = with_copies(history, rows, self._copies)
            noise.append(self.model.initial_noise(self._copies * len(rows), self._generator))
        steps, pace = self._pace(history)
        plan = self.model.plan(history, torch.cat(noise), steps, self._guided, pace)
        return Planned(
            samples=all_samples(plan.imputed, rows, count).double().numpy(),
            red_steps=self._recent.red_steps,
            known=self._recent.known,
            future=plan.future[:count].double().numpy(),
            logits=plan.logits[:count].double().numpy(),
        )

    def _pace(self, history: History) -> tuple[int, Pace | None]:
        """The reverse steps of a decision, and who takes fewer."""
        blind = (~(history.observable & history.slots).any(dim=1)).nonzero().squeeze(1)
        if self._blind_steps <= self._sampling_steps or not len(blind):
            return self._sampling_steps, None
        return self._blind_steps, Pace(blind, self._sampling_steps)

    def _history(self) -> History:
        recent = self._recent
        return History(
            values=torch.from_numpy(recent.values),
            known=torch.from_numpy(recent.known),
            green=torch.from_numpy(recent.green),
            red_steps=torch.from_numpy(recent.red_steps),
            observable=self._observable,
            slots=self._slots,
            neighbours=self._neighbours,
            downstream=self._downstream,
            phases=self._phases,
            phase_mask=self._phase_mask,
        )
