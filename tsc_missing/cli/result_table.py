"""The table that closes a run."""

from itertools import chain
from pathlib import Path

from rich.console import Console
from rich.table import Table

from tsc_missing.config import RunSettings
from tsc_missing.controllers.catalogue import (
    DIFFLIGHT,
    FULL_INFORMATION,
    NATIVE,
    by_value,
    is_learned,
    looks_at_nothing,
    needs_values,
)
from tsc_missing.controllers.diffusion_weights import DIFFLIGHT_PAPER
from tsc_missing.controllers.fallback import Safe
from tsc_missing.controllers.resolved import weights_of
from tsc_missing.evaluation.metrics import Result
from tsc_missing.evaluation.run import Prepared
from tsc_missing.imputation.registry import DIFFUSION


def print_result(prepared: Prepared, result: Result, folder: Path) -> None:
    """Print what ran, what it came to, and where it was written, to standard output."""
    console = Console(highlight=False, soft_wrap=True)
    console.print(f"{heading(prepared)}\n", markup=False)
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="bold")
    table.add_column(justify="right")
    table.add_column(style="dim")
    for name, value, meaning in rows(result):
        table.add_row(name, value, meaning)
    console.print(table)
    more = (_sees_all, _unused, _other_interval, _other_sensors, _fallback, _observed_in_the_log)
    for warning in [*warnings(result), *chain(*(tell(prepared) for tell in more))]:
        console.print(f"warning: {warning}", style="yellow", markup=False)
    console.print(f"\nwritten to {folder}", markup=False)


def _sees_all(prepared: Prepared) -> list[str]:
    settings = prepared.settings
    if settings.controller not in FULL_INFORMATION or settings.missing.pattern == "none":
        return []
    return [
        f"SUMO runs {settings.controller} itself, and it sees everything: nothing is missing for it"
    ]


def _unused(prepared: Prepared) -> list[str]:
    """Options that were given and did nothing for this controller."""
    settings, usual = prepared.settings, RunSettings()
    name, found, default = settings.controller, settings.diffusion, usual.diffusion
    values, decides = needs_values(name), by_value(name, found)
    composed = name not in NATIVE and not looks_at_nothing(name)
    generates = name in (DIFFLIGHT, DIFFLIGHT_PAPER) or (values and settings.imputer == DIFFUSION)
    given = (
        ("--imputer", settings.imputer, usual.imputer, values),
        ("--blind", settings.blind, usual.blind, composed),
        ("--weights", found.weights, default.weights, generates),
        ("--sampling-steps", found.sampling_steps, default.sampling_steps, generates),
        ("--samples", found.samples, default.samples, decides),
        ("--scoring", found.scoring, default.scoring, name == DIFFLIGHT),
        ("--policy-weights", settings.q_weights, usual.q_weights, decides or is_learned(name)),
    )
    return [
        f"{name} has no use for {option} {value}, which did nothing"
        for option, value, default_value, is_used in given
        if value != default_value and not is_used
    ]


def _other_interval(prepared: Prepared) -> list[str]:
    settings, usual = prepared.settings, RunSettings().signals.decision_interval
    if settings.signals.decision_interval == usual or not weights_of(settings):
        return []
    return [f"the weights learned from decisions every {usual} s"]


def _other_sensors(prepared: Prepared) -> list[str]:
    if prepared.settings.sensor.kind == "lane" or not weights_of(prepared.settings):
        return []
    return ["the weights learned from sensors that cover whole lanes"]


def _fallback(prepared: Prepared) -> list[str]:
    controller = prepared.controller
    error = controller.last_error if isinstance(controller, Safe) else ""
    return [f"the fallback answered because of: {error}"] if error else []


def _observed_in_the_log(prepared: Prepared) -> list[str]:
    if not weights_of(prepared.settings):
        return []
    from tsc_missing.evaluation.blind_set import observed_in_the_log

    found = observed_in_the_log(prepared)
    if found is None:
        return []
    ids, seed = found
    return [
        f"the log that the weights learned from observed {len(ids)} of the blind intersections "
        f"({', '.join(ids)}); with --mask-seed {seed} it observed none of them"
    ]


def heading(prepared: Prepared) -> str:
    """One line that says what ran."""
    settings: RunSettings = prepared.settings
    return (
        f"{prepared.scenario.name} ({prepared.scenario.demand_kind} demand), "
        f"{settings.controller}, {_missing_in_words(prepared)}, seed {settings.seed}"
    )


def _missing_in_words(prepared: Prepared) -> str:
    missing = prepared.settings.missing
    if prepared.settings.controller in FULL_INFORMATION:
        return "everything observed"
    if missing.file:
        return f"missing as in {missing.file}"
    if missing.pattern == "none":
        return "everything observed"
    variant = f" ({missing.variant})" if missing.variant else ""
    return f"{missing.pattern}{variant} missing at rate {missing.rate:g}"


def rows(result: Result) -> list[tuple[str, str, str]]:
    """Name, value and meaning of what is worth showing."""

    def seconds(value: float | None) -> str:
        return "–" if value is None else f"{value:.1f} s"

    stops = []
    if result.stops is not None:
        stops = [("stops", f"{result.stops:.2f}", "mean over inserted vehicles")]
    lines = [
        ("travel time", seconds(result.att_all), "mean over all demand (att_all)"),
        ("95th percentile", seconds(result.p95_travel_time), "over all demand"),
        ("on approaches", seconds(result.att_approach), "mean, the paper's metric (att_approach)"),
        ("finished trips", seconds(result.att_finished), "mean, from insertion (att_finished)"),
        ("time loss", seconds(result.time_loss), "mean over inserted vehicles"),
        ("waiting to enter", seconds(result.depart_delay), "mean over all demand"),
        *stops,
        (
            "vehicles",
            f"{result.finished} of {result.demand}",
            f"finished; {result.never_inserted} never entered",
        ),
        ("queue", f"{result.mean_queue:.1f}", "vehicles below 0.1 m/s, mean over the run"),
        ("missing", f"{100 * result.missing_share:.1f} %", "of movement readings"),
    ]
    if result.imputation_mae is not None:
        lines.append(
            ("imputation error", f"{result.imputation_mae:.2f}", "vehicles, mean absolute")
        )
    if result.decision_ms_median is not None:
        lines.append(("decision", f"{result.decision_ms_median:.2f} ms", "median"))
    lines.append(("speed", f"{result.sim_s_per_wall_s:.0f} ×", "real time"))
    return lines


def warnings(result: Result) -> list[str]:
    """What a user should know about a run that did not go as runs should."""
    found = []
    if result.gridlock:
        found.append("the network was gridlocked at the end (docs/metrics.md)")
    for count, what in (
        (result.fallbacks, "decisions were answered by the safe fallback (docs/metrics.md)"),
        (result.held_greens, "changes of phase had to wait for the minimum green"),
        (result.teleports, "vehicles were teleported"),
        (result.collisions, "collisions"),
        (result.emergency_brakings, "emergency brakings"),
    ):
        if count:
            found.append(f"{count} {what}")
    return found
