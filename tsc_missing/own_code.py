"""Controllers and imputers of users' own, named ``FILE.py:CLASS`` or ``MODULE:CLASS``."""

import hashlib
import importlib
import importlib.util
import inspect
import sys
from pathlib import Path
from types import ModuleType
from typing import TypeVar

from tsc_missing.errors import UserError, nearest

SEPARATOR = ":"
SUFFIX = ".py"

T = TypeVar("T")


def is_own(name: str) -> bool:
    """Whether a name says where somebody's own class is, and is none that is registered here."""
    return SEPARATOR in name


def class_name(name: str) -> str:
    """The last part of such a name, and any other name as it is."""
    return name.rpartition(SEPARATOR)[2]


def own_class(name: str, field: str, *kinds: type[T]) -> type[T]:
    """The class that ``name`` says, a subclass of one of ``kinds``.

    ``UserError`` names the ``field``.

    A file is loaded once a process as long as its bytes stay the same, and finds modules beside it.
    """
    place, _, attribute = name.rpartition(SEPARATOR)
    module = _module(name, place, field)
    found = getattr(module, attribute, None)
    if inspect.isclass(found) and issubclass(found, kinds):
        if inspect.isabstract(found):
            missing = ", ".join(sorted(getattr(found, "__abstractmethods__", ())))
            raise UserError(field, name, f"it must define {missing}")
        return found
    there = [
        key
        for key, value in vars(module).items()
        if inspect.isclass(value) and issubclass(value, kinds) and not inspect.isabstract(value)
    ]
    bases = " or ".join(f"{kind.__module__}.{kind.__name__}" for kind in kinds)
    wanted = f"it must be a subclass of {bases}"
    raise UserError(
        field, name, f"{wanted}; {nearest(attribute, there) if there else 'none there'}"
    )


def make_own(name: str, field: str, kind: type[T]) -> T:
    """One of the class that ``name`` says, made without arguments."""
    found = own_class(name, field, kind)
    try:
        return found()
    except UserError:
        raise
    except Exception as error:
        raise _raised(field, name, "making one", error) from error


def own_file(name: str, field: str) -> Path:
    """The file that the class is in; ``UserError`` where there is none."""
    place = name.rpartition(SEPARATOR)[0]
    if place.endswith(SUFFIX):
        path = Path(place)
    else:
        path = Path(str(_module(name, place, field).__file__))
    if not path.is_file():
        raise UserError(field, name, f"there is no file {path}")
    return path


def _module(name: str, place: str, field: str) -> ModuleType:
    if not place:
        raise UserError(field, name, "it must be FILE.py:CLASS or MODULE:CLASS")
    try:
        if place.endswith(SUFFIX):
            return _module_of_file(own_file(name, field))
        _find_in(Path.cwd())
        return importlib.import_module(place)
    except UserError:
        raise
    except Exception as error:
        raise _raised(field, name, f"loading {place}", error) from error


def _module_of_file(path: Path) -> ModuleType:
    path = path.resolve()
    digest = hashlib.sha256(path.as_posix().encode() + b"\0" + path.read_bytes()).hexdigest()
    unique = f"{path.stem}_{digest[:12]}"
    if unique in sys.modules:
        return sys.modules[unique]
    _find_in(path.parent)
    spec = importlib.util.spec_from_file_location(unique, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[unique] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[unique]
        raise
    return module


def _find_in(folder: Path) -> None:
    """Let modules of the folder be imported, after all others."""
    if str(folder) not in sys.path:
        sys.path.append(str(folder))


def _raised(field: str, name: str, doing: str, error: Exception) -> UserError:
    words = f"{doing} raised {type(error).__name__}: {error}"
    return UserError(field, name, words, verdict="cannot be used")
