"""Single runs beside each other: their results, their settings and their intersections."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeGuard

from pydantic import BaseModel, ConfigDict, FiniteFloat, TypeAdapter

from tsc_missing.batch.keys import dotted, leaves
from tsc_missing.errors import UserError
from tsc_missing.evaluation.run_folder import RUN, is_whole
from tsc_missing.files import parse, read_json
from tsc_missing.network.folder import NET
from tsc_missing.report.comparable import short_digest
from tsc_missing.report.places import Each, Place, read_places

FIELD = "run"
DRAWN = "profile"  # the demand that is scaled


class Settings(BaseModel):
    """The settings of a run; those that are not named here differ by version."""

    model_config = ConfigDict(extra="allow")

    net: str
    demand: Literal["auto", "profile", "recorded"]
    controller: str


class RunFile(BaseModel):
    """What is needed of a ``run.json``, of an older version too."""

    settings: Settings
    resolved: dict[str, Any] = {}
    scenario: str
    demand: str
    begin: float = 0.0
    checksums: dict[str, str] = {}
    versions: dict[str, str] = {}
    result: dict[str, bool | FiniteFloat | None]


@dataclass(frozen=True)
class FinishedRun:
    """A run folder that was read."""

    folder: Path
    file: RunFile
    places: tuple[Place, ...]

    @cached_property
    def settings(self) -> dict[str, object]:
        """All settings by their dotted names."""
        return {dotted(key): value for key, value in leaves(self.file.settings.model_dump())}

    @cached_property
    def facts(self) -> dict[str, object]:
        """All that a run depends on, by names that say where in ``run.json`` it stands."""
        file = self.file
        digests = {name: short_digest(digest) for name, digest in file.checksums.items()}
        groups = {"resolved": file.resolved, "checksums": digests, "versions": file.versions}
        more = {f"{at}.{name}": it for at, table in groups.items() for name, it in table.items()}
        return {**self.settings, "demand_kind": file.demand, "begin": file.begin, **more}

    @cached_property
    def world(self) -> dict[str, object]:
        """What is not the controller's: who drives where and when, and for how long it is seen."""
        drawn = ("volume",) if self.file.demand == DRAWN else ()  # the seed is SUMO's, too
        names = (
            "horizon",
            "seed",
            *drawn,
            *(key for key in self.settings if key.startswith("vehicle.")),
        )
        checksums = self.file.checksums
        demand = next((it for key, it in checksums.items() if key.startswith("demand: ")), None)
        return {
            "the demand": self.file.demand,
            "the demand's file": short_digest(demand),
            "the network's file": short_digest(checksums.get(NET)),
            "begin": self.file.begin,
            "libsumo": self.file.versions.get("libsumo"),
            **{name: self.settings.get(name) for name in names},
        }


@dataclass(frozen=True)
class Change:
    """A place in all runs; ``delays`` are how much more its delay [s] is than in the first run."""

    places: tuple[Place, ...]
    delays: tuple[float | None, ...]  # of all runs but the first; None where nobody came

    @property
    def largest(self) -> float:
        """The change of delay [s] that is furthest from none."""
        return max((it for it in self.delays if it is not None), key=abs, default=0.0)


@dataclass(frozen=True)
class Comparison:
    """One run or more, the first of which is the base."""

    runs: tuple[FinishedRun, ...]
    each: Each

    @cached_property
    def differing(self) -> dict[str, list[object]]:
        """The values in each run of everything that differs; None where a run has no such thing."""
        names = dict.fromkeys(name for run in self.runs for name in run.facts)
        values = {name: [run.facts.get(name) for run in self.runs] for name in names}
        return {name: of for name, of in values.items() if any(it != of[0] for it in of)}

    @cached_property
    def warnings(self) -> list[str]:
        """What makes runs differ beside what controls the signals."""
        found = []
        for number, run in enumerate(self.runs[1:], start=2):
            base, world = self.runs[0].world, run.world
            names = [name for name in base if name in world and base[name] != world[name]]
            unlike = [f"{name} ({base[name]}, {world[name]})" for name in names]
            if unlike:
                found.append(
                    f"runs 1 and {number} differ in {', '.join(unlike)}: "
                    "what differs in their results is not the controllers' alone"
                )
        return found

    @cached_property
    def changes(self) -> list[Change]:
        """All places, the worst first: by the delay of the only run, or by its change."""
        by_key = [{place.key: place for place in run.places} for run in self.runs]
        rows = [Change(places, _delays(places)) for places in _rows(by_key)]
        if len(self.runs) == 1:
            return sorted(rows, key=lambda row: -(row.places[0].delay or 0.0))
        return sorted(rows, key=lambda row: -row.largest)

    def most_changed(self, count: int) -> list[Change]:
        """So many of ``changes``, in their order: the worst of one run, of more most changed."""
        if len(self.runs) == 1:
            return self.changes[:count]
        far = [abs(row.largest) for row in self.changes]
        most = sorted(range(len(far)), key=lambda k: -far[k])[:count]
        return [self.changes[k] for k in sorted(most)]


def _rows(by_key: Sequence[dict[tuple[str, str | None], Place]]) -> list[tuple[Place, ...]]:
    return [tuple(places[key] for places in by_key) for key in by_key[0]]


def _delays(places: Sequence[Place]) -> tuple[float | None, ...]:
    base = places[0].delay
    others = [place.delay for place in places[1:]]
    return tuple(None if it is None or base is None else it - base for it in others)


def difference(base: object, value: object) -> tuple[float | None, float | None]:
    """``value`` minus ``base``, and that in per cent of ``base``; None where there is no such."""
    if not (_is_number(base) and _is_number(value)):
        return None, None
    more = value - base
    return more, 100.0 * more / base if base else None


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def compare(folders: Sequence[Path], each: Each) -> Comparison:
    """Read run folders; ``UserError`` where one is none, or they are of other intersections."""
    runs = tuple(_read(folder, each) for folder in folders)
    for run in runs[1:]:
        _check_network(runs[0], run)
    return Comparison(runs, each)


def _read(folder: Path, each: Each) -> FinishedRun:
    if not is_whole(folder):
        raise UserError(FIELD, folder, f"it has no {RUN}, so it is no run folder")
    content = read_json(folder / RUN, FIELD)
    file = parse(TypeAdapter(RunFile), content, FIELD, folder / RUN)
    return FinishedRun(folder, file, read_places(folder, each, FIELD))


def _check_network(base: FinishedRun, run: FinishedRun) -> None:
    here, there = ({place.key for place in it.places} for it in (run, base))
    if here == there:
        return
    odd = min(here ^ there, key=lambda key: tuple(map(str, key)))
    name, which = " ".join(filter(None, odd)), run if odd in here else base
    raise UserError(
        FIELD,
        run.folder,
        f"only {which.folder} has {name}; compare runs of one network",
        verdict=f"is of another network than {base.folder}",
    )
