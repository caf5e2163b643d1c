"""Where a run goes that was not told where."""

import contextlib
import itertools
from collections.abc import Iterator
from pathlib import Path

from tsc_missing.config import RunSettings
from tsc_missing.files import check_writable
from tsc_missing.own_code import class_name


@contextlib.contextmanager
def default_folder(settings: RunSettings) -> Iterator[Path]:
    """An empty folder that no other run has or takes, named after this; it goes if it stays empty.

    Raises ``UserError`` where none can be made.
    """
    runs, name = Path("runs"), _name(settings)
    is_new = not runs.exists()
    names = itertools.chain([name], (f"{name}-{k}" for k in itertools.count(2)))
    folder = next(path for path in (runs / name for name in names) if _made(path))
    try:
        yield folder
    except BaseException:
        with contextlib.suppress(OSError):
            folder.rmdir()
            if is_new:
                runs.rmdir()
        raise


def _made(folder: Path) -> bool:
    """Make a folder; whether that was possible, or it is another run's."""
    if folder.exists():
        return False
    check_writable(folder, "out")
    try:
        folder.mkdir(parents=True)
    except FileExistsError:  # another run was faster
        return False
    return True


def _name(settings: RunSettings) -> str:
    missing = settings.missing
    drawn = [missing.pattern, *filter(None, [missing.variant])]
    rate = [f"{missing.rate:g}"] if missing.pattern != "none" else []
    what = [
        Path(settings.net).name,
        *([missing.file_words] if missing.file else [*drawn, *rate]),
        class_name(settings.controller),
        f"seed{settings.seed}",
    ]
    return "-".join(what)
