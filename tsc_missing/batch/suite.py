"""Suites: TOML files that say which runs a batch consists of (``docs/batches.md``)."""

import csv
import itertools
import re
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NoReturn

from pydantic import ValidationError

from tsc_missing.batch.keys import SETTINGS, dotted, leaves, nested, overlap
from tsc_missing.batch.keys import Path as Key
from tsc_missing.config import RunSettings, Settings
from tsc_missing.controllers.diffusion_weights import fill_in
from tsc_missing.errors import UserError, nearest
from tsc_missing.evaluation.overview import missing_words
from tsc_missing.files import first_problem
from tsc_missing.network.folder import canonical
from tsc_missing.paths import bundled

FIELD = "suite"
METHODS = bundled("scenarios") / "methods.toml"
PAPER = bundled("scenarios") / "paper" / "results.csv"  # the numbers of the paper's tables
LONGEST = 200  # characters of a run's name, which is that of files too
FILE = ("missing", "file")  # looked for beside the suite, and then in the current folder
TOP = ("title", "about", "paper", "methods", "runs")
ABOUT_METHODS = ("paper", "train", "trained")
METHOD_GROUPS = (
    "controller",
    "imputer",
    "blind",
    "diffusion",
    "q_weights",
)  # settings that make a method,
METHOD_KEYS = (  # and so do these
    ("turning_counts",),
    ("count_error",),
    ("signals", "min_space"),
    ("signals", "max_red"),
)


class RunSpec(Settings):
    """One run of a suite."""

    name: str  # of its folder
    dataset: str  # the network, and what else of the scenario varies in the suite
    case: str  # what is missing, in words
    method: str  # the method's name, and what of it varies in the suite
    paper: str | None = None  # what the paper calls the method
    train: str | None = None  # the command that makes the method's weights
    trained: str | None = None  # the case that the weights were trained on
    defined: tuple[str, ...] | None = None  # settings that make the method; of old plans not known
    settings: RunSettings


class Suite(Settings):
    """A suite as it was read: its runs in the order of the file."""

    name: str
    title: str
    about: str = ""
    paper: tuple[str, ...] = ()  # the paper's tables that it repeats
    runs: tuple[RunSpec, ...]


def bundled_suites() -> dict[str, Path]:
    """The bundled suites by name."""
    folder = bundled("scenarios") / "suites"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


@cache
def bundled_methods() -> tuple[str, ...]:
    """The names of methods that every suite knows beside those of controllers."""
    return tuple(_load(METHODS))


@cache
def paper_tables() -> tuple[str, ...]:
    """The names of the paper's tables whose numbers are bundled."""
    with PAPER.open(encoding="utf-8", newline="") as stream:
        return tuple(dict.fromkeys(row["table"] for row in csv.DictReader(stream)))


def read_suite(suite: str, changes: Sequence[str] = ()) -> Suite:
    """The suite of a TOML file, or of a bundled one by its name.

    ``changes`` are texts ``KEY=VALUE`` that replace a key's values in all of its runs. Raises
    ``UserError`` for whatever is wrong in it.
    """
    path = _find(suite)
    return _Reader(path, _load(path), [_change(text) for text in changes]).suite()


def _find(suite: str) -> Path:
    path, known = Path(suite), bundled_suites()
    if path.is_file():
        return path
    if suite in known:
        return known[suite]
    raise UserError(FIELD, suite, f"there is no such file; {nearest(suite, known)}")


def _load(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UserError(FIELD, path, f"the file cannot be read ({error.strerror})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UserError(FIELD, path, f"not valid TOML: {error}") from None


def _change(text: str) -> tuple[Key, Any]:
    key, found, value = text.partition("=")
    path = tuple(key.strip().split("."))
    if not found:
        raise UserError("--set", text, "it must be KEY=VALUE, as seed=[0,1]")
    if path != ("method",) and path not in SETTINGS:
        known = ["method", *map(dotted, SETTINGS)]
        raise UserError("--set", text, f"no such key; {nearest(dotted(path), known)}")
    try:
        return path, tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return path, value.strip()


class _Reader:
    """One suite file; every problem is a ``UserError`` that says where it is."""

    def __init__(self, path: Path, content: Mapping[str, Any], changes: list[tuple[Key, Any]]):
        self._path = path
        self._content = content
        self._changes = changes

    def suite(self) -> Suite:
        content = self._content
        self._known("top level", content, TOP)
        own = self._table("methods")
        tables = {**_load(METHODS), **own}
        self._methods = {name: self._method(name, table) for name, table in tables.items()}
        blocks = content.get("runs")
        if not isinstance(blocks, list) or not blocks:
            self._wrong("runs", "a suite needs at least one [[runs]]")
        runs = [run for k, block in enumerate(blocks, 1) for run in self._block(k, block)]
        long = max((run.name for run in runs), key=len)
        if len(long) > LONGEST:
            words = f"the run {long[:40]}… has a name of {len(long)} characters"
            self._wrong("runs", f"{words}, and {LONGEST} is the most: name its method in [methods]")
        twice = [name for name, count in Counter(run.name for run in runs).items() if count > 1]
        if twice:
            self._wrong("runs", f"two runs are called {twice[0]}; names must differ")
        try:
            suite = Suite(
                name=self._path.stem,
                title=content.get("title", self._path.stem),
                about=content.get("about", ""),
                paper=content.get("paper", ()),
                runs=tuple(runs),
            )
        except ValidationError as error:
            raise UserError(FIELD, self._path, first_problem(error)) from None
        for name in suite.paper:
            if name not in paper_tables():
                self._wrong("paper", f"unknown table {name}; {nearest(name, paper_tables())}")
        return suite

    def _table(self, key: str) -> Mapping[str, Any]:
        table = self._content.get(key, {})
        if not isinstance(table, Mapping):
            self._wrong(key, "it must be a table")
        return table

    def _method(self, name: str, table: Any) -> tuple[dict[str, Any], dict[Key, Any]]:
        """What is said about a method, and its settings."""
        where = f"methods.{name}"
        if not isinstance(table, Mapping):
            self._wrong(where, "it must be a table")
        about = {key: table[key] for key in ABOUT_METHODS if key in table}
        settings = {}
        for key, value in leaves({k: v for k, v in table.items() if k not in about}):
            if key not in SETTINGS:
                self._unknown(where, dotted(key), [*ABOUT_METHODS, *map(dotted, SETTINGS)])
            settings[key] = value
        return about, settings

    def _block(self, number: int, block: Any) -> Iterator[RunSpec]:
        where = f"runs {number}"
        if not isinstance(block, Mapping):
            self._wrong(where, "it must be a table")
        found = list(leaves(block))
        axes = dict(found)
        if len(axes) < len(found):
            key = next(key for key, times in Counter(key for key, _ in found).items() if times > 1)
            self._wrong(f"{where}.{dotted(key)}", "it is there twice")
        for key, value in self._changes:
            for old, kept in axes.items():
                if isinstance(kept, list) and len(old) < len(key) and overlap(old, key):
                    words = f"{dotted(old)} is a list of tables in {where}: set all of it"
                    raise UserError("--set", dotted(key), words)
            axes = {old: kept for old, kept in axes.items() if not overlap(old, key)}
            axes[key] = value
        for key, values in axes.items():
            if key not in SETTINGS and key != ("method",):
                self._unknown(where, dotted(key), ["method", *map(dotted, SETTINGS)])
            if values in ([], {}):
                self._wrong(f"{where}.{dotted(key)}", "it has no value")
        axes.setdefault(("method",), RunSettings().controller)
        axes.setdefault(("net",), RunSettings().net)
        lists = [v if isinstance(v, list) else [v] for v in axes.values()]
        varied = [key for key, values in axes.items() if isinstance(values, list)]
        for values in itertools.product(*lists):
            yield self._run(where, dict(zip(axes, values, strict=True)), varied)

    def _run(self, where: str, values: dict[Key, Any], varied: list[Key]) -> RunSpec:
        method = str(values.pop(("method",)))
        about, settings = self._methods.get(method, ({}, {("controller",): method}))
        about = {**about, "defined": tuple(map(dotted, settings))}
        settings = dict(settings)
        varying: list[Key] = []  # what varies, where a list of tables is an axis the keys in these
        for key, value in values.items():
            parts = list(leaves(value, key)) if isinstance(value, Mapping) else [(key, value)]
            varying += [part for part, _ in parts if key in varied]
            for part, single in parts:
                if part not in SETTINGS:
                    self._unknown(where, dotted(part), map(dotted, SETTINGS))
                if part in settings:
                    self._wrong(f"{where}.{dotted(part)}", f"the method {method} sets it too")
                settings[part] = single
        file = settings.get(FILE)
        if isinstance(file, str) and (beside := self._path.parent / file).is_file():
            settings[FILE] = str(beside)
        try:
            run = RunSettings.model_validate(nested(settings))
            if isinstance(about.get("train"), str):
                about = {**about, "train": fill_in(about["train"], run)}
            return RunSpec(**about, **_labels(method, run, settings, varying), settings=run)
        except ValidationError as error:
            self._wrong(where, first_problem(error))

    def _known(self, where: str, table: Mapping[str, Any], keys: Sequence[str]) -> None:
        for key in table:
            if key not in keys:
                self._unknown(where, key, keys)

    def _unknown(self, where: str, key: str, known: Any) -> NoReturn:
        self._wrong(where, f"unknown key {key}; {nearest(key, known)}")

    def _wrong(self, where: str, what: str) -> NoReturn:
        raise UserError(FIELD, self._path, f"at {where}: {what}")


def _labels(
    method: str, run: RunSettings, settings: Mapping[Key, Any], varied: Sequence[Key]
) -> dict[str, str]:
    """The run's name, and its dataset, case and method in words."""
    named = ("net", "missing", "method", "seed")
    extra = [key for key in varied if key[0] not in named]
    decides = [key for key in extra if key[0] in METHOD_GROUPS or key in METHOD_KEYS]
    of_method = [f"{key[-1]} {settings[key]}" for key in decides]
    of_scene = [f"{key[-1]} {settings[key]}" for key in extra if key not in decides]
    missing, net = run.missing, Path(canonical(run.net)).name
    what: list[str] = [missing.file_words if missing.file else missing.pattern]
    if missing.pattern not in ("none", "file"):
        what += [*filter(None, [missing.variant]), f"{missing.rate:g}"]
        if ("missing", "mean_outage") in settings:
            what.append(f"outage{missing.mean_outage:g}")
    parts = [net, *of_scene, *what, method, *of_method, f"seed{run.seed}"]
    return {
        "name": "-".join(slug(part) for part in parts),
        "dataset": ", ".join([net, *of_scene]),
        "case": case_words(run),
        "method": ", ".join([method, *of_method]),
    }


def case_words(run: RunSettings) -> str:
    """What is missing, for example ``random 50 %``."""
    missing = run.missing
    if missing.pattern == "none":
        return "none"
    default = type(missing).model_fields["mean_outage"].default
    outage = "" if missing.mean_outage == default else f", outages of {missing.mean_outage:g} steps"
    return f"{missing_words(missing)}{outage}"


def slug(text: str) -> str:
    """The text with nothing in it that a file name should not have."""
    return re.sub(r"[^A-Za-z0-9.+=_-]+", "_", text).strip("_.") or "_"
