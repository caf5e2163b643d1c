"""Which runs may stand beside each other in a report."""

import json
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from tsc_missing.batch.keys import dotted, leaves
from tsc_missing.errors import UserError
from tsc_missing.evaluation.run_folder import MASK
from tsc_missing.network.folder import NET

if TYPE_CHECKING:
    from tsc_missing.report.results import Run

FIELD = "results"
UNTOLD: dict[str, Any] = {  # seeds, and what checksums and the demand's kind tell
    **dict.fromkeys(("seed", "mask_seed", "net", "demand"), True),
    "missing": {"file"},
}
INPUTS = ("weights: ", "code: ")  # checksums of what a method is made of

Facts = dict[str, object]


def check_comparable(runs: Iterable["Run"]) -> None:
    """Raise ``UserError`` where runs that are compared, or averaged, differ in what they must not.

    Those of a dataset are of one world, whatever their case, method and seed; those of a method
    have the same sensors, weights and code in all cases; those of a cell the same settings; and
    those of a case and seed the same mask.
    """
    runs = tuple(runs)
    _check_alike(runs, lambda run: (run.spec.dataset,), _world)
    _check_alike(runs, lambda run: (run.spec.dataset, run.spec.method), _means)
    _check_alike(runs, lambda run: (run.spec.dataset, run.spec.case, run.spec.method), _settings)
    _check_alike(runs, lambda run: (run.spec.dataset, run.spec.case, _seed(run)), _mask)


def _check_alike(
    runs: Iterable["Run"],
    group: Callable[["Run"], tuple[object, ...]],
    facts: Callable[["Run"], Facts],
) -> None:
    """What is None is not known."""
    known: dict[tuple[object, ...], tuple[object, Run]] = {}
    for run in runs:
        for name, there in facts(run).items():
            if there is None:
                continue
            here, one = known.setdefault((*group(run), name), (there, run))
            if here != there:
                raise UserError(
                    FIELD,
                    run.folder,
                    f"that of {one.folder} is {here}; give them reports of their own",
                    verdict=f"cannot be compared: {name} is {there}",
                )


def _world(run: "Run") -> Facts:
    settings = run.spec.settings
    return {
        "demand": run.row["demand_kind"],
        "the network's file": short_digest(_checksums(run).get(NET)),
        "the demand's file": next(iter(_digests(run, "demand: ").values()), None),
        "volume": settings.volume,
        "horizon": settings.horizon,
        **{f"vehicle.{name}": value for name, value in settings.vehicle.model_dump().items()},
    }


def _means(run: "Run") -> Facts:
    sensor = run.spec.settings.sensor.model_dump().items()
    return {**{f"sensor.{name}": value for name, value in sensor}, **_digests(run, *INPUTS)}


def _settings(run: "Run") -> Facts:
    """All but seeds, and what has another path on another machine."""
    found = run.spec.settings.model_dump(mode="json", exclude=UNTOLD)
    settings: Facts = {dotted(key): str(value) for key, value in leaves(found)}
    if run.spec.settings.missing.file_words == "replayed":  # a mask a seed
        return settings
    return {**settings, **_digests(run, "mask: ")}


def _mask(run: "Run") -> Facts:
    """None of SUMO's own programs."""
    return {"mask": run.row[f"{MASK}_sha256"]}


def _seed(run: "Run") -> int:
    return run.spec.settings.seed


def _checksums(run: "Run") -> dict[str, str]:
    found: dict[str, str] = json.loads(run.row["checksums"] or "{}")
    return found


def _digests(run: "Run", *kinds: str) -> Facts:
    return {
        name: short_digest(it) for name, it in _checksums(run).items() if name.startswith(kinds)
    }


def short_digest(digest: str | None) -> str | None:
    """A checksum as it is told."""
    return None if digest is None else digest[:12]
