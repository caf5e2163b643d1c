"""Tiny models and made-up intersections."""

from dataclasses import replace

import torch

from tsc_missing.diffusion.config import DiffLightConfig
from tsc_missing.diffusion.difflight import DiffLightModel
from tsc_missing.diffusion.history import History, Plan
from tsc_missing.diffusion.windows import Windows

TINY = DiffLightConfig(width=16, heads=2, hidden=16, inverse_width=16, diffusion_steps=20)
PUBLISHED = DiffLightConfig.as_published().model_copy(
    update={"width": 16, "heads": 2, "hidden": 16, "inverse_width": 16, "diffusion_steps": 20}
)
VARIANTS = {
    "difflight": TINY,
    "published": PUBLISHED,
    "two layers": TINY.model_copy(update={"layers": 2}),
    "unet": TINY.model_copy(update={"noise_model": "unet", "padded_rewards": True}),
    "padded": TINY.model_copy(update={"padded_rewards": True}),
    "no dcm": TINY.model_copy(update={"dcm": False}),
    "no downstream": TINY.model_copy(update={"downstream": False}),
    "no neighbours": TINY.model_copy(update={"neighbours": False}),
    "no inverse dynamics": TINY.model_copy(update={"inverse_dynamics": False}),
}


def model(config: DiffLightConfig = TINY, seed: int = 0) -> DiffLightModel:
    torch.manual_seed(seed)
    made = DiffLightModel(config).eval()
    with torch.no_grad():
        for weight in made.parameters():  # fresh zeros would hide what an input does
            weight.add_(0.2 * torch.randn(weight.shape))
    return made


def line(count: int) -> torch.Tensor:
    """(N, 12, 3): each intersection is fed, from the east, by all eastern slots of the next."""
    table = torch.full((count, 12, 3), -1)
    for n in range(count - 1):
        table[n, 3:6] = 12 * (n + 1) + torch.tensor([3, 4, 5])
    return table


def line_downstream(count: int) -> torch.Tensor:
    """(N, 12, 3): the same roads as ``line``, seen from upstream."""
    table = torch.full((count, 12, 3), -1)
    for n in range(1, count):
        table[n, 3:6] = 12 * (n - 1) + torch.tensor([3, 4, 5])
    return table


def phases(count: int) -> torch.Tensor:
    """(N, 4, 12): phases A to D."""
    table = torch.zeros(count, 4, 12, dtype=torch.bool)
    for phase, slots in enumerate(([4, 10], [1, 7], [3, 9], [0, 6])):
        table[:, phase, slots] = True
    return table


def history(count: int = 3, observed: float = 0.6, seed: int = 0) -> History:
    g = torch.Generator().manual_seed(seed)
    shape = (count, 5, 12)
    known = torch.rand(shape, generator=g) < observed
    values = 20 * torch.rand(*shape, 2, generator=g)
    return History(
        values=torch.where(known.unsqueeze(-1), values, torch.nan),
        known=known,
        green=torch.rand(shape, generator=g) < 0.3,
        red_steps=torch.randint(0, 10, shape, generator=g),
        observable=torch.ones(count, 12, dtype=torch.bool),
        slots=torch.ones(count, 12, dtype=torch.bool),
        neighbours=line(count),
        downstream=line_downstream(count),
        phases=phases(count),
        phase_mask=torch.ones(count, 4, dtype=torch.bool),
    )


def plan(
    made: DiffLightModel, present: History, steps: int = 4, noise: torch.Tensor | None = None
) -> Plan:
    if noise is None:
        noise = made.initial_noise(len(present.slots), torch.Generator().manual_seed(1))
    return made.plan(present, noise, steps)


def three_way(present: History) -> History:
    """The same without the northern approach; what was there is not known."""
    slots = present.slots.clone()
    slots[:, :3] = False
    return replace(present, slots=slots, known=present.known & slots.unsqueeze(1))


def windows(count: int = 24, seed: int = 0, recorded: float = 0.9) -> Windows:
    """Queues that a phase clears, so that there is something to learn."""
    g = torch.Generator().manual_seed(seed)
    there = torch.rand(count, 8, 12, generator=g) < recorded
    action = torch.randint(0, 4, (count,), generator=g)
    values = 4 + 4 * torch.rand(count, 8, 12, 2, generator=g)
    served = phases(count)[torch.arange(count), action]
    values[:, 5] = torch.where(served.unsqueeze(-1), 0.5, values[:, 4] + 1)
    near = torch.rand(count, 4, 3, 8, generator=g)
    down = torch.rand(count, 12, 3, 8, generator=g)
    return Windows(
        values=torch.where(there.unsqueeze(-1), values, torch.nan),
        recorded=there,
        hidden=torch.rand(count, 8, 1, generator=g).expand(-1, -1, 12) < 0.3,
        observable=torch.ones(count, 12, dtype=torch.bool),
        green=torch.rand(count, 8, 12, generator=g) < 0.3,
        red_steps=torch.randint(0, 10, (count, 8, 12), generator=g),
        slots=torch.ones(count, 12, dtype=torch.bool),
        phases=phases(count),
        phase_mask=torch.ones(count, 4, dtype=torch.bool),
        action=action,
        near_values=torch.where(near < 0.8, 10 * near, torch.nan)
        .unsqueeze(-1)
        .expand(-1, -1, -1, -1, 2),
        near_given=near < 0.8,
        near_green=near < 0.3,
        near_red_steps=(10 * near).long(),
        near_exists=torch.rand(count, 4, 3, generator=g) < 0.8,
        down_values=torch.where(down < 0.8, 10 * down, torch.nan)
        .unsqueeze(-1)
        .expand(-1, -1, -1, -1, 2),
        down_given=down < 0.8,
        down_exists=torch.rand(count, 12, 3, generator=g) < 0.8,
    )
