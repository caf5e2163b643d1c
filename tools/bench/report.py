"""Tables for people and values for JSON, from the costs of programs."""

import dataclasses
import os
import platform
from collections.abc import Mapping, Sequence
from typing import Any

from tools.bench.processes import Cost, Spread, ratio, spread

QUANTITIES = ("wall", "cpu", "memory")
UNITS = {"wall": "s", "cpu": "s", "memory": "MB"}


@dataclasses.dataclass(frozen=True)
class Target:
    """What a ratio of two programs may be at most."""

    program: str
    base: str
    quantity: str
    limit: float


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Columns under a header; all but the first are flush right."""
    lines = [list(header), *map(list, rows)]
    widths = [max(len(line[k]) for line in lines) for k in range(len(header))]
    return "\n".join(
        "  ".join(
            cell.rjust(width) if k else cell.ljust(width)
            for k, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    )


def cost_table(costs: Mapping[str, Sequence[Cost]], base: str) -> str:
    """A row a program: median (lowest to highest) of each quantity, and times ``base``'s."""
    header = ["", *(f"{what} [{UNITS[what]}]" for what in QUANTITIES)]
    header += [f"{what} / {base}" for what in QUANTITIES]
    rows = [
        [
            name,
            *(show(spread(taken, what), 0 if what == "memory" else 2) for what in QUANTITIES),
            *(show(ratio(taken, costs[base], what), 2) for what in QUANTITIES),
        ]
        for name, taken in costs.items()
    ]
    return table(header, rows)


def show(values: Spread, digits: int) -> str:
    """For example ``1.08 (1.05–1.12)``."""
    return f"{values.median:.{digits}f} ({values.low:.{digits}f}–{values.high:.{digits}f})"


def verdict(target: Target, costs: Mapping[str, Sequence[Cost]]) -> str:
    """Whether the median of the rounds' ratios keeps to a target, in words."""
    found = ratio(costs[target.program], costs[target.base], target.quantity)
    met = "met" if found.median <= target.limit else "MISSED"
    return (
        f"{target.quantity}: {target.program} / {target.base} = {show(found, 2)}, "
        f"target at most {target.limit:g}: {met}"
    )


def values(costs: Mapping[str, Sequence[Cost]], base: str) -> dict[str, Any]:
    """Every measured number, and the spreads of the ratios to ``base``."""
    return {
        "costs": {
            name: [dataclasses.asdict(cost) for cost in taken] for name, taken in costs.items()
        },
        f"ratios to {base}": {
            name: {what: dataclasses.asdict(ratio(taken, costs[base], what)) for what in QUANTITIES}
            for name, taken in costs.items()
        },
    }


def machine() -> dict[str, Any]:
    """What the numbers depend on besides the programs."""
    return {
        "cores": os.cpu_count(),
        "machine": platform.machine(),
        "system": platform.system(),
        "python": platform.python_version(),
    }
