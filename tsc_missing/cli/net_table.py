"""The tables that ``tsc-net show`` prints."""

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from tsc_missing.evaluation.overview import Summary
from tsc_missing.network.summary import SensorSummary, SignalSummary
from tsc_missing.words import counted


def print_summary(
    summary: Summary, picture: Path, all_phases: bool = False, lanes: bool = False
) -> None:
    """Print a network in numbers, its phases, and where its picture is, to standard output.

    ``all_phases``: those of every kind of intersection, with the ids, not of the commonest only.
    ``lanes``: those of every movement, too.
    """
    console = Console(highlight=False, soft_wrap=True)
    console.print(f"{summary.name} ({summary.kind})\n", markup=False)
    console.print(_table(rows(summary)))
    signals = summary.network.signals
    for kind in signals if all_phases else signals[:1]:
        alike = counted(kind.intersections, "intersection")
        which = f": {', '.join(kind.ids)}" if all_phases else ""
        console.print(f"\nphases of {alike}{which}", markup=False)
        console.print(_table(phase_rows(kind)))
    others = summary.network.intersections - signals[0].intersections
    if others and not all_phases:
        kinds = counted(len(signals) - 1, "kind")
        unlike = f"{counted(others, 'intersection')} {'has' if others == 1 else 'have'}"
        console.print(f"{unlike} other phases ({kinds}; --phases lists them)", markup=False)
    if lanes:
        console.print("\nlanes that the sensor of each movement covers", markup=False)
        for each in summary.network.movements:
            words = f"{each.intersection}  {each.movement}  {' '.join(each.lanes)}"
            console.print(words, markup=False)
    console.print(f"\nwritten to {picture}", markup=False)


def _table(lines: Sequence[tuple[str, ...]]) -> Table:
    table = Table(box=None, show_header=False, pad_edge=False)
    for row in lines:
        table.add_row(*row)
    return table


def rows(summary: Summary) -> list[tuple[str, str, str]]:
    """Name, value and meaning of what is worth showing."""
    network = summary.network
    lines = [
        ("intersections", f"{network.intersections}", "with signals"),
        ("entrance lanes", f"{network.entrance_lanes}", "a sensor each"),
        ("movement slots", f"{network.slots_present}", f"present; {network.slots_absent} absent"),
        ("roads", f"{network.roads}", "each direction counts"),
        ("entries", f"{network.boundary_entries}", "roads by which vehicles come from outside"),
        (
            "length",
            f"{network.road_length / 1000:.2f} km",
            f"of roads; {network.lane_length / 1000:.2f} km of lanes",
        ),
    ]
    if summary.demand is not None:
        demand = summary.demand
        what = f"vehicles in {demand.horizon} s, {demand.kind}"
        lines.append(("demand", f"{demand.vehicles}", what))
    else:
        lines.append(("demand", "none", ""))
    return lines + (_sensor_rows(summary.sensors) if summary.sensors is not None else [])


def _sensor_rows(sensors: SensorSummary) -> list[tuple[str, str, str]]:
    return [
        (
            "missing",
            f"{100 * sensors.missing_share:.1f} %",
            f"of readings in {sensors.steps} steps, {sensors.source}",
        ),
        ("never observed", f"{len(sensors.never_observed)}", "intersections"),
        ("partly observed", f"{sensors.partly_observed}", "intersections"),
        ("blind slots", f"{sensors.slots_never_observed}", "movement slots that never report"),
    ]


def phase_rows(kind: SignalSummary) -> list[tuple[str, str, str]]:
    """Number, name and slots of each phase of a kind of intersection."""
    lines = [(f"{p}", phase.name, ", ".join(phase.slots)) for p, phase in enumerate(kind.phases)]
    return lines + ([("", "always", ", ".join(kind.always_green))] if kind.always_green else [])
