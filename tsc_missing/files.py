"""Reading a user's files into pydantic models, with one-line errors, and writing whole files."""

import contextlib
import hashlib
import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, TypeAdapter, ValidationError

from tsc_missing.errors import UserError, nearest

# The name that ``replace_file`` gives what is not whole yet, of the files that come first.
TEMPORARY = re.compile(r"\.(checkpoint\.safetensors|plan\.json|settings\.json)\.\d+")
KEPT = "; what was saved before is whole, and --resume goes on from it"

T = TypeVar("T")


def read_json(path: Path, field: str) -> Any:
    """The JSON value in a file; ``UserError`` names ``field`` when it is not there or not JSON."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UserError(field, path, f"the file cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise UserError(field, path, "the file is not text but must be JSON") from None
    except json.JSONDecodeError as error:
        raise UserError(
            field, path, f"not valid JSON, or cut off, at line {error.lineno} ({error.msg})"
        ) from None


def parse(adapter: TypeAdapter[T], value: object, field: str, path: object) -> T:
    """``value`` as the adapter's type; ``UserError`` tells the first thing wrong with it."""
    try:
        return adapter.validate_python(value)
    except ValidationError as error:
        raise UserError(field, path, first_problem(error)) from None


def first_problem(error: ValidationError, model: type[BaseModel] | None = None) -> str:
    """The first of pydantic's complaints as words: where, what is there, what is wanted.

    ``model`` is what was validated: then a name that it does not have brings those that it has.
    """
    first = error.errors(include_url=False)[0]
    place = ".".join(str(part) for part in first["loc"]) or "top level"
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    known = _fields(model, first["loc"][:-1]) if first["type"] == "extra_forbidden" else ()
    if known:
        return f"at {place}: there is no such setting; {nearest(str(first['loc'][-1]), known)}"
    words = first["msg"].removeprefix("Value error, ")
    of_several = not first["loc"] and isinstance(first["input"], dict)  # which says it by itself
    found = "" if of_several else f", found {str(first['input'])[:60]!r}"
    return f"at {place}: {words}{found}{more}"


def _fields(model: object, place: Sequence[object]) -> tuple[str, ...]:
    """The names of a model's fields, or of those of the group at ``place`` in it."""
    if not (isinstance(model, type) and issubclass(model, BaseModel)):
        return ()
    if not place:
        return tuple(model.model_fields)
    field = model.model_fields.get(str(place[0]))
    return () if field is None else _fields(field.annotation, place[1:])


def sha256(path: Path) -> str:
    """The SHA-256 of a file as hexadecimal digits."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def check_writable(folder: Path, field: str) -> None:
    """Raise ``UserError`` unless there can be a folder, which is new or empty; makes none.

    What is to be renamed to it cannot take the place of a link, of a mount or of where one is.
    """
    if folder.is_symlink() or os.path.ismount(folder):
        what = "a link" if folder.is_symlink() else "where a file system is mounted"
        raise UserError(field, folder, f"it is {what}; name a new folder")
    if folder.exists() and folder.samefile(os.curdir):
        raise UserError(field, folder, "it is the current folder; name a new one")
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise UserError(field, folder, "it must name a folder that does not exist yet, or is empty")
    parent = next(p for p in folder.absolute().parents if p.exists())
    if not parent.is_dir():
        raise UserError(field, folder, f"{parent} is a file, not a folder")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise UserError(field, folder, f"no permission to write in {parent}")


@contextlib.contextmanager
def written_into(folder: Path, field: str, kept: str = "") -> Iterator[None]:
    """``UserError`` about ``folder`` where the block cannot write; ``kept`` says what is left."""
    try:
        yield
    except ConnectionError:
        raise
    except OSError as error:
        words = f"cannot be written ({error.strerror or error}){kept}"
        raise UserError(field, folder, words) from error


def sync(path: Path) -> None:
    """Have a file or folder on the disk before this returns."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def replace_file(path: Path, content: bytes) -> None:
    """Write a file that is whole, with the old or the new content, at any moment.

    Raises ``OSError`` where it cannot be written; nothing half-written stays behind.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        temporary.write_bytes(content)
        sync(temporary)
        temporary.replace(path)
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def whole_folder(folder: Path, field: str, durable: bool = False) -> Iterator[Path]:
    """A temporary folder that becomes ``folder`` when the block ends well, and else goes away.

    ``durable``: what is in it is on the disk before it gets its name, so that not even a loss of
    power leaves a folder that is not whole.
    """
    check_writable(folder, field)
    made = [p for p in [folder.absolute(), *folder.absolute().parents][1:] if not p.exists()]
    temporary: Path | None = None
    try:
        folder.absolute().parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.absolute().parent))
        temporary.chmod(0o755)
        yield temporary
        if durable:
            for path in (*temporary.rglob("*"), temporary):
                sync(path)
        temporary.rename(folder)
    except BaseException as error:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)
        for parent in made:
            with contextlib.suppress(OSError):
                parent.rmdir()
        if isinstance(error, OSError) and not isinstance(error, ConnectionError):
            words = error.strerror or str(error)
            elsewhere = error.filename is not None and str(temporary) not in str(error.filename)
            place = f": {error.filename}" if elsewhere else ""
            raise UserError(field, folder, f"cannot be written ({words}{place})") from error
        raise


def check_new_training(folder: Path) -> None:
    """Raise ``UserError`` unless a training can begin in the folder.

    A new one, an empty one, or what one left that was killed before it had anything to go on from.
    """
    if folder.is_dir() and not is_barely_begun(folder):
        raise UserError("out", folder, "it is there already; --resume goes on with it")
    if not folder.is_dir():
        check_writable(folder, "out")


def is_barely_begun(folder: Path) -> bool:
    """Whether a folder has nothing but what a kill leaves of the first moment; that goes away."""
    left = [path for path in folder.rglob("*") if not path.is_dir()]
    if not all(TEMPORARY.fullmatch(path.name) for path in left):
        return False
    for path in left:
        path.unlink(missing_ok=True)
    return True


def check_begun_training(folder: Path, file: str) -> None:
    """Raise ``UserError`` unless a training was begun in the folder; ``file`` is from its start."""
    if not (folder / file).is_file():
        words = f"no training was begun there (it has no {file}); without --resume one begins"
        raise UserError("resume", folder, words)
