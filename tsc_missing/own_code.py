"""Controllers and imputers of users' own, named ``FILE.py:CLASS`` or ``MODULE:CLASS``."""

import contextlib
import hashlib
import importlib
import importlib.util
import inspect
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import TypeVar

from tsc_missing.errors import UserError, nearest

SEPARATOR = ":"
SUFFIX = ".py"
FORM = "FILE.py:CLASS or MODULE:CLASS"
INSTALLED = {"site-packages", "dist-packages"}  # where packages are, in an environment or a system

T = TypeVar("T")

_brought: set[str] = set()  # modules that files of users' own have imported from beside them
_folders: set[str] = set()  # that have been put on the path for it


def is_own(name: str) -> bool:
    """Whether a name says where somebody's own class is, and is none that is registered here."""
    return SEPARATOR in name or name.endswith(SUFFIX)


def class_name(name: str) -> str:
    """The last part of such a name, and any other name as it is."""
    return name.rpartition(SEPARATOR)[2]


def own_class(name: str, field: str, *kinds: type[T]) -> type[T]:
    """The class that ``name`` says, a subclass of one of ``kinds``.

    ``UserError`` names the ``field``. A file is loaded once a process as long as its bytes stay the
    same, and finds modules beside it first, as a script does.
    """
    return _class_in(_module(name, field, anew=False), name, field, *kinds)


def make_own(name: str, field: str, kind: type[T]) -> T:
    """One of the class that ``name`` says, made without arguments.

    Its file is loaded anew, with the modules beside it: what they keep is of one run.
    """
    found = _class_in(_module(name, field, anew=True), name, field, kind)
    with named(name, field, "making one"), set_apart():
        return found()


def own_digest(name: str, field: str) -> str:
    """SHA-256 of the file that the name says and, if it is another one, of that with the class."""
    module = _module(name, field, anew=False)
    files = [Path(str(module.__file__))]
    with contextlib.suppress(TypeError, OSError):
        source = inspect.getsourcefile(getattr(module, class_name(name)))
        files += [Path(source)] if source and Path(source).resolve() != files[0].resolve() else []
    digest = hashlib.sha256()
    for path in files:
        digest.update(path.read_bytes())
    return digest.hexdigest()


@contextlib.contextmanager
def set_apart() -> Iterator[None]:
    """What the code prints goes to the error stream; whatever it raises is an error like others.

    But for a ``KeyboardInterrupt``, which is a user's Ctrl-C.
    """
    with contextlib.redirect_stdout(sys.stderr):
        try:
            yield
        except (Exception, KeyboardInterrupt):
            raise
        except SystemExit as error:
            raise RuntimeError(f"it called sys.exit({error.code})") from error
        except BaseException as error:
            raise RuntimeError(f"it raised {type(error).__name__}: {error}") from error


@contextlib.contextmanager
def named(name: str, field: str, doing: str) -> Iterator[None]:
    """What goes wrong in the block is a ``UserError`` that says what was done."""
    try:
        yield
    except UserError:
        raise
    except Exception as error:
        words = f"{doing} raised {type(error).__name__}: {error}"
        raise UserError(field, name, words, verdict="cannot be used") from error


def _class_in(module: ModuleType, name: str, field: str, *kinds: type[T]) -> type[T]:
    attribute = class_name(name)
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
    known = nearest(attribute, there) if there else "none there"
    raise UserError(field, name, f"{wanted}; {known}")


def _module(name: str, field: str, anew: bool) -> ModuleType:
    place, _, attribute = name.rpartition(SEPARATOR)
    if not place or not attribute or place.startswith(SEPARATOR):
        raise UserError(field, name, f"it must be {FORM}")
    if not place.endswith(SUFFIX):
        with named(name, field, f"loading {place}"), set_apart():
            _find_in(Path.cwd())
            if anew:
                sys.modules.pop(place, None)
            return importlib.import_module(place)
    path = Path(place)
    if not path.is_file():
        raise UserError(field, name, f"there is no file {place}")
    with named(name, field, f"loading {place}"), set_apart():
        return _module_of_file(path.resolve(), anew)


def _module_of_file(path: Path, anew: bool) -> ModuleType:
    digest = hashlib.sha256(path.as_posix().encode() + b"\0" + path.read_bytes()).hexdigest()
    unique = f"{path.stem}_{digest[:12]}"
    if unique in sys.modules and not anew:
        return sys.modules[unique]
    for other in _brought:
        sys.modules.pop(other, None)  # that of another file may have the same name
    sys.path.insert(0, str(path.parent))
    before = set(sys.modules)
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
    finally:
        sys.path.remove(str(path.parent))
        for folder in _folders & set(sys.path):
            sys.path.remove(folder)
        _find_in(path.parent)  # what it imports later, in a function
        _brought.update(filter(lambda one: _is_below(one, path.parent), {*sys.modules} - before))
    return module


def _is_below(module: str, folder: Path) -> bool:
    """Whether a module that is loaded comes from a folder, and not from a package installed there.

    Nor is it this project, in whose checkout the folder may be.
    """
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is None or module.partition(".")[0] == __name__.partition(".")[0]:
        return False
    path = Path(file).resolve()
    return path.is_relative_to(folder) and not INSTALLED & {*path.parts}


def _find_in(folder: Path) -> None:
    """Let modules of the folder be imported, after all others."""
    if str(folder) not in sys.path:
        sys.path.append(str(folder))
        _folders.add(str(folder))
