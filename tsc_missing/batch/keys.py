"""The keys of a suite: settings of a run by their dotted paths."""

from collections.abc import Iterator, Mapping
from typing import Any, TypeGuard

from pydantic import BaseModel

from tsc_missing.config import RunSettings

Path = tuple[str, ...]  # of a setting, as ("missing", "rate")


def is_group(kind: object) -> TypeGuard[type[BaseModel]]:
    """Whether a field of this annotation is a group of settings."""
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _paths(model: type[BaseModel]) -> Iterator[Path]:
    for name, field in model.model_fields.items():
        yield (name,)
        kind = field.annotation
        if is_group(kind):
            yield from ((name, *rest) for rest in _paths(kind))


SETTINGS = frozenset(_paths(RunSettings))
GROUPS = frozenset(path[:-1] for path in SETTINGS if len(path) > 1)


def dotted(path: Path) -> str:
    """For example ``missing.rate``."""
    return ".".join(path)


def leaves(table: Mapping[str, Any], at: Path = ()) -> Iterator[tuple[Path, Any]]:
    """Everything in nested tables that is no table, with its path."""
    for key, value in table.items():
        path = (*at, *key.split("."))
        if isinstance(value, Mapping) and (value or path not in GROUPS):
            yield from leaves(value, path)
        else:
            yield path, value


def nested(values: Mapping[Path, Any]) -> dict[str, Any]:
    """The tables that ``leaves`` was given."""
    found: dict[str, Any] = {}
    for path, value in values.items():
        table = found
        for part in path[:-1]:
            table = table.setdefault(part, {})
        table[path[-1]] = value
    return found


def overlap(one: Path, other: Path) -> bool:
    """Whether one path is the other or leads to it."""
    shorter = min(len(one), len(other))
    return one[:shorter] == other[:shorter]
