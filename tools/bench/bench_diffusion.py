"""Speed of DiffLight on this machine, on made-up data: training and deciding.

    python tools/bench/bench_diffusion.py [--threads 2] [--windows 256] [--repeats 20]
        [--clock wall] [--config JSON]

Prints windows a second for forward, backward and optimiser step, milliseconds a decision of ten
reverse steps with both guidance branches, and the floor that the matrix products alone would
take at the best rate measured here; and milliseconds that a decision of ``--controller difflight``
takes to generate what it believes, with half of the readings lost and with a quarter of the
intersections blind. On a machine that others use too, ``--threads 1 --clock cpu`` counts only the
time that this process got.
"""

import argparse
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import torch
from torch.utils.flop_counter import FlopCounterMode

from tsc_missing.config import DiffusionSettings
from tsc_missing.diffusion.batch import (
    Inputs,
    TrainingBatch,
    gather_downstream,
    gather_neighbours,
)
from tsc_missing.diffusion.config import DiffLightConfig, Precision
from tsc_missing.diffusion.difflight import DiffLightModel
from tsc_missing.diffusion.ema import Ema
from tsc_missing.diffusion.history import History
from tsc_missing.diffusion.memory import keep_freed_memory
from tsc_missing.diffusion.pace import Pace

PHASES = 4
SLOTS = 12
ROWS = 4  # intersections in a column of the made-up grid
PRECISIONS: tuple[Precision, ...] = ("float32", "bfloat16")


def grid_neighbours(count: int) -> torch.Tensor:
    """(N, 12, 3): a grid of ``ROWS`` rows; the approach from a side is fed by the node there."""
    table = torch.full((count, SLOTS, 3), -1)
    for n in range(count):
        x, y = divmod(n, ROWS)
        for approach, (dx, dy) in enumerate(((0, 1), (1, 0), (0, -1), (-1, 0))):
            if 0 <= y + dy < ROWS and 0 <= (x + dx) * ROWS < count:
                feeder = ((x + dx) * ROWS + y + dy) * SLOTS
                turns = torch.tensor([3 * ((approach + side) % 4) + turn for side, turn in FEEDS])
                table[n, 3 * approach : 3 * approach + 3] = feeder + turns
    return table


FEEDS = ((0, 1), (1, 0), (3, 2))  # straight on, from the left, from the right


def phase_table(count: int) -> torch.Tensor:
    """(N, 4, 12): straight and left of opposite approaches."""
    table = torch.zeros(count, PHASES, SLOTS, dtype=torch.bool)
    for phase, slots in enumerate(([4, 10], [1, 7], [3, 9], [0, 6])):
        table[:, phase, slots] = True
    return table


def training_batch(config: DiffLightConfig, windows: int, seed: int = 0) -> TrainingBatch:
    """Noise in the shape of ``windows`` windows, whole networks of 16 intersections."""
    g = torch.Generator().manual_seed(seed)
    t, c = config.steps, config.history
    values = torch.rand(windows, t, SLOTS, 2, generator=g)
    recorded = torch.ones(windows, t, SLOTS, dtype=torch.bool)
    known = torch.rand(windows, t, 1, generator=g).expand(-1, -1, SLOTS) > 0.3
    known = known & (torch.arange(t) < c)[:, None]
    green = torch.rand(windows, t, SLOTS, generator=g) > 0.7
    signals = torch.rand(windows, t, SLOTS, 2, generator=g)
    table = torch.cat(
        [
            torch.where(block >= 0, block + 16 * SLOTS * number, -1)
            for number, block in enumerate([grid_neighbours(16)[:, ::3]] * (windows // 16))
        ]
    )
    inputs = Inputs(
        known=known,
        slots=torch.ones(windows, SLOTS, dtype=torch.bool),
        reward=torch.rand(windows, t, generator=g),
        reward_known=known[:, :, 0],
        observable=recorded,
        signals=signals,
        neighbours=gather_neighbours(values, recorded, signals, table),
        downstream=gather_downstream(values, recorded, grid_downstream(windows)),
    )
    return TrainingBatch(
        inputs=inputs,
        values=values,
        target=~known,
        green=green,
        phases=phase_table(windows),
        phase_mask=torch.ones(windows, PHASES, dtype=torch.bool),
        action=torch.randint(0, PHASES, (windows,), generator=g),
        action_known=torch.ones(windows, dtype=torch.bool),
    )


def grid_downstream(count: int) -> torch.Tensor:
    """(N, 12, 3): every slot leads to the slots of some approach."""
    first = torch.arange(count * SLOTS).view(count, SLOTS, 1) // 3 * 3
    return first + torch.arange(3)


def history(config: DiffLightConfig, count: int, seed: int = 0) -> History:
    """A made-up present of ``count`` intersections, half of it not observed."""
    g = torch.Generator().manual_seed(seed)
    shape = (count, config.history, SLOTS)
    return History(
        values=20 * torch.rand(*shape, 2, generator=g),
        known=torch.rand(*shape[:2], 1, generator=g).expand(shape) > 0.5,
        green=torch.rand(shape, generator=g) > 0.7,
        red_steps=torch.randint(0, 10, shape, generator=g),
        observable=torch.ones(count, SLOTS, dtype=torch.bool),
        slots=torch.ones(count, SLOTS, dtype=torch.bool),
        neighbours=grid_neighbours(count),
        downstream=grid_downstream(count),
        phases=phase_table(count),
        phase_mask=torch.ones(count, PHASES, dtype=torch.bool),
    )


Generation = tuple[History, torch.Tensor, int, Pace | None]


def as_in_a_run(model: DiffLightModel, count: int) -> dict[str, Generation]:
    """What the default controller generates of ``count`` intersections, by what is missing."""
    settings = DiffusionSettings()
    seen_steps, blind_steps = settings.reverse_steps(guided=False)
    present = history(model.config, count)
    blind = torch.arange(0, count, 4)
    known, observable = present.known.clone(), present.observable.clone()
    known[blind], observable[blind] = False, False
    holes = replace(present, known=known, observable=observable)
    rows = (~holes.observable.any(dim=1)).nonzero().squeeze(1)
    g = torch.Generator().manual_seed(0)
    return {
        "half of the readings lost": (present, model.initial_noise(count, g), seen_steps, None),
        "a quarter blind": (
            holes,
            model.initial_noise(len(holes.slots), g),
            blind_steps,
            Pace(rows, seen_steps),
        ),
    }


class Stopwatch:
    """Times calls by the clock on the wall, or by the time that this process was given."""

    def __init__(self, clock: str, repeats: int) -> None:
        """``clock`` is wall or cpu."""
        self.clock = time.process_time if clock == "cpu" else time.perf_counter
        self.repeats = repeats

    def __call__(self, call: Callable[[], object]) -> tuple[float, float]:
        """Median and least time of a call [s], after three calls that don't count."""
        for _ in range(3):
            call()
        times = []
        for _ in range(self.repeats):
            start = self.clock()
            call()
            times.append(self.clock() - start)
        return statistics.median(times), min(times)


def flops(call: Callable[[], object]) -> int:
    """Floating-point operations of the matrix products in a call."""
    with FlopCounterMode(display=False) as counter:
        call()
    return int(counter.get_total_flops())


def peak(precision: Precision, timed: Stopwatch) -> float:
    """Best rate of a product of 1024 x 1024 matrices [FLOP/s]."""
    a = torch.randn(1024, 1024).to(getattr(torch, precision))
    _, best = timed(lambda: a @ a)
    return 2 * 1024**3 / best


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--windows", type=int, default=256, help="a multiple of 16")
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--clock", choices=("wall", "cpu"), default="wall")
    parser.add_argument("--sampling-steps", type=int, default=10)
    parser.add_argument("--config", default="{}", help="DiffLightConfig as JSON")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    torch.manual_seed(0)
    keep_freed_memory()
    timed = Stopwatch(options.clock, options.repeats)
    config = DiffLightConfig.model_validate_json(options.config)
    model = DiffLightModel(config)
    weights = sum(p.numel() for p in model.parameters())
    print(f"{weights} weights, {options.threads} threads; median (best)")
    batch = training_batch(config, options.windows)
    generator = torch.Generator().manual_seed(0)
    optimiser = torch.optim.AdamW(model.parameters(), lr=2e-4, foreach=True)
    ema = Ema(model)

    def train() -> None:
        optimiser.zero_grad()
        model.loss(batch, generator).total.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        ema.update(model)

    for precision in PRECISIONS:
        model.use(precision)
        rate = peak(precision, timed)
        print(f"{precision}: products at {rate / 1e9:.0f} GFLOP/s at best")
        median, best = timed(train)
        floor = flops(train) / rate
        print(
            f"  training, {options.windows} windows: {options.windows / median:.0f}"
            f" ({options.windows / best:.0f}) windows/s; floor {options.windows / floor:.0f}"
        )
        for count in (16, 48):
            present = history(config, count)
            noise = model.initial_noise(count, generator)

            def decide(present: History = present, noise: torch.Tensor = noise) -> None:
                model.plan(present, noise, options.sampling_steps)

            median, best = timed(decide)
            floor = flops(decide) / rate
            print(
                f"  {options.sampling_steps}-step decision of {count}: {1e3 * median:.1f}"
                f" ({1e3 * best:.1f}) ms; floor {1e3 * floor:.1f} ms"
            )
            for what, (seen, start, steps, pace) in as_in_a_run(model, count).items():
                generate = partial(model.plan, seen, start, steps, guided=False, pace=pace)
                median, best = timed(generate)
                print(f"  default, {what}, {count}: {1e3 * median:.1f} ({1e3 * best:.1f}) ms")


if __name__ == "__main__":
    main()
