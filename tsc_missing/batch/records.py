"""What finished runs say of themselves, held against what would be run now."""

from collections.abc import Iterator, Mapping
from pathlib import PurePath
from typing import Any

from pydantic import BaseModel, ValidationError

from tsc_missing.batch.keys import is_group
from tsc_missing.batch.suite import RunSpec
from tsc_missing.config import RunSettings
from tsc_missing.controllers.resolved import resolved
from tsc_missing.evaluation.run import checksums, inputs_of
from tsc_missing.evaluation.scenario import Scenario
from tsc_missing.versions import versions

Difference = tuple[str, Any, Any]  # the place, what is there and what is wanted


class Inputs:
    """The checksums of what runs read, as it was when it was first asked for."""

    def __init__(self, scenarios: Mapping[str, Scenario]) -> None:
        """``scenarios`` are those of the runs by name."""
        self._scenarios = scenarios
        self._known: dict[tuple[object, ...], dict[str, str]] = {}

    def of(self, spec: RunSpec) -> dict[str, str]:
        """Those of a run."""
        key = inputs_of(spec.settings)
        if key not in self._known:
            self._known[key] = checksums(spec.settings, self._scenarios[spec.name])
        return self._known[key]


def differences(
    record: dict[str, Any], spec: RunSpec, inputs: Inputs, any_version: bool
) -> Iterator[tuple[str, Difference | None]]:
    """In what a run that is there may differ from the one that is wanted, the cheapest first."""
    found, wanted = record.get("settings"), spec.settings.model_dump(mode="json")
    if not any_version:
        yield "versions", first_difference(record.get("versions"), versions())
    found = known_settings(found) if any_version else found
    yield "settings", first_difference(_by_name(found), _by_name(wanted))
    yield "resolved settings", _resolved_difference(record, spec.settings)
    yield "checksums", first_difference(record.get("checksums"), inputs.of(spec))


def _by_name(settings: Any) -> Any:
    """Settings whose mask is called by its file's name alone; the checksums say which it is."""
    match settings:
        case {"missing": {"file": str(file)} as missing}:
            return {**settings, "missing": {**missing, "file": PurePath(file).name}}
    return settings


def first_difference(found: Any, wanted: Any, at: str = "") -> Difference | None:
    """Where two JSON values differ first, and the two values there."""
    if isinstance(found, dict) and isinstance(wanted, dict):
        for key in [*wanted, *(key for key in found if key not in wanted)]:
            place = f"{at}.{key}" if at else str(key)
            deeper = first_difference(found.get(key), wanted.get(key), place)
            if deeper is not None:
                return deeper
        return None
    return None if found == wanted else (at, found, wanted)


def _resolved_difference(record: Mapping[str, Any], settings: RunSettings) -> Difference | None:
    """Where a run's settings came to something else than ``settings`` would now.

    Only of what both versions write; without weights there are no sampling steps.
    """
    was, now = record.get("resolved"), resolved(settings)
    if not isinstance(was, dict):
        return None
    both = [key for key in now if key in was and (now["weights"] or key != "sampling_steps")]
    return first_difference({key: was[key] for key in both}, {key: now[key] for key in both})


def known_settings(found: Any) -> Any:
    """Settings that another version wrote, as this one would: what it did not know by default.

    What this version does not know is left out. Returned as they are where a value is none that
    this version allows.
    """
    try:
        settings = RunSettings.model_validate(_known(found, RunSettings))
    except ValidationError:
        return found
    return settings.model_dump(mode="json")


def _known(found: Any, model: type[BaseModel]) -> Any:
    """``found`` without what ``model`` has no field for, in its groups too."""
    if not isinstance(found, dict):
        return found
    kinds = {name: field.annotation for name, field in model.model_fields.items()}
    groups = {name: kind for name, kind in kinds.items() if is_group(kind)}
    return {
        name: _known(value, groups[name]) if name in groups else value
        for name, value in found.items()
        if name in kinds
    }
