"""What of a suite cannot run, found before anything starts."""

from collections.abc import Iterable, Sequence

from tsc_missing.baselines.config import SETTINGS as BASELINES
from tsc_missing.baselines.config import train_command
from tsc_missing.batch.suite import RunSpec
from tsc_missing.controllers.catalogue import NATIVE
from tsc_missing.controllers.registry import POLICY_WEIGHTS, controller_of
from tsc_missing.controllers.resolved import weights_of
from tsc_missing.errors import UserError
from tsc_missing.evaluation.run import check_as_built, check_timing
from tsc_missing.evaluation.scenario import Scenario, find_scenario
from tsc_missing.network.folder import network_name
from tsc_missing.sensing.masks_of_runs import mask_of
from tsc_missing.weights.find import COMMAND
from tsc_missing.weights.find import FIELD as WEIGHTS

METHODS, LACKING = "methods", "have no weights here"  # field and verdict of an error


def available(runs: Sequence[RunSpec], skip: bool) -> tuple[tuple[RunSpec, ...], dict[str, str]]:
    """The runs whose weights are there, and the methods that lack some with what makes them.

    Baselines have weights for one network each, so a method of these is named with its network.
    Unless they are to be skipped, ``UserError`` names those methods and the commands that make
    their weights.
    """
    lacking: dict[str, str] = {}
    problems: dict[tuple[object, ...], UserError | None] = {}
    there = []
    for run in runs:
        settings = run.settings
        key = (
            settings.controller,
            settings.imputer,
            settings.blind,
            settings.diffusion,
            settings.q_weights,
            weights_of(settings),
        )
        if key not in problems:
            problems[key] = _problem(run)
        problem = problems[key]
        if problem is None:
            there.append(run)
        elif problem.field in (WEIGHTS, POLICY_WEIGHTS) and (skip or _is_made_by_a_command(run)):
            method, command = _lacks(run)
            lacking[method] = _also(lacking.get(method), command)
        else:
            field = f"method {run.method}, {problem.field}"
            raise UserError(field, problem.value, problem.allowed, problem.verdict)
    if lacking and not skip:
        raise UserError(
            METHODS,
            lacking_words(lacking),
            "make them, or run the rest with --skip-unavailable",
            verdict=LACKING,
        )
    return tuple(there), lacking


def _is_made_by_a_command(run: RunSpec) -> bool:
    """Whether it is known what makes a run's weights; else somebody wrote a name or a path."""
    return run.train is not None or run.settings.controller in BASELINES


def _lacks(run: RunSpec) -> tuple[str, str]:
    """The method of a run without weights, and the command that makes these."""
    settings = run.settings
    if settings.controller in BASELINES:
        net = network_name(settings.net)
        return f"{run.method} on {net}", train_command(settings.controller, net)
    return run.method, run.train or COMMAND


def _also(commands: str | None, command: str) -> str:
    """Shell commands, one after the other, with another one that may be among them."""
    before = commands.split("; ") if commands else []
    return "; ".join(dict.fromkeys([*before, command]))


def lacking_words(lacking: dict[str, str]) -> str:
    """For example ``BC (`tsc-train bc`), CQL (`tsc-train cql`)``."""
    return ", ".join(f"{method} (`{command}`)" for method, command in lacking.items())


def _problem(run: RunSpec) -> UserError | None:
    settings = run.settings
    if settings.controller in NATIVE:
        return None
    try:
        controller_of(settings)
    except UserError as error:
        return error
    return None


def _check_mask(run: RunSpec, scenario: Scenario) -> None:
    """Raise ``UserError`` where the run's mask cannot be had."""
    try:
        mask_of(run.settings, scenario.folder.network)
    except UserError as error:
        if not run.settings.missing.file:
            raise
        words = f"{error.allowed} (in the run {run.name})"
        raise UserError("missing.file", error.value, words, error.verdict) from None


def check_scenarios(runs: Iterable[RunSpec]) -> dict[str, Scenario]:
    """The scenario of every run by its name; ``UserError`` where a run could not start.

    Each network, demand, timing and pattern of missing data is looked at once.
    """
    scenarios: dict[tuple[str, str], Scenario] = {}
    seen: set[tuple[object, ...]] = set()
    found = {}
    for run in runs:
        settings = run.settings
        where = (settings.net, settings.demand)
        if where not in scenarios:
            scenarios[where] = find_scenario(settings.net, settings.demand)
        found[run.name] = scenario = scenarios[where]
        check_as_built(settings.controller, scenario)
        demand = (*where, settings.volume, settings.horizon)
        if demand not in seen:
            scenario.demand(settings)
        timing = (*where, settings.signals)
        if timing not in seen:
            check_timing(settings.signals, scenario.folder.network)
        mask = (*where, settings.missing, settings.horizon, settings.signals.decision_interval)
        if mask not in seen:
            _check_mask(run, scenario)
        seen |= {demand, timing, mask}
    return found
