"""What all commands share: exit statuses, one-line errors, the app's settings."""

import contextlib
import functools
import itertools
import os
import signal
import sys
from collections.abc import Callable
from types import FrameType
from typing import TYPE_CHECKING, NoReturn

import typer

from tsc_missing.errors import UserError

if TYPE_CHECKING:
    from rich.console import Console

DONE, FAILED, MISTAKE, INTERRUPTED = 0, 1, 2, 130

OTHER_NAMES = {"q_weights": "--policy-weights"}

NOTHING_KEPT = "nothing was kept"
FINISHED_KEPT = "what was finished before stays, and the same command goes on"


@functools.cache
def messages() -> "Console":
    """Where progress and errors are drawn: the error stream; rich is loaded by the first use."""
    from rich.console import Console

    return Console(stderr=True, soft_wrap=True, highlight=False)


def make_app(help_text: str) -> typer.Typer:
    """A typer app with this project's conventions."""
    return typer.Typer(
        help=help_text,
        add_completion=False,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )


def run_app(app: typer.Typer, name: str, kept: str = NOTHING_KEPT) -> NoReturn:
    """Run an app: a user's mistake is one line and status 2, Ctrl-C 130, anything else 1.

    SIGTERM, which schedulers of clusters and ``timeout`` send, is a Ctrl-C. ``kept`` says what is
    left after one that the app did not take itself.
    """
    sys.exit(_status(lambda: _call(app, name), kept))


def run_app_and_leave(app: typer.Typer, name: str) -> NoReturn:
    """``run_app``, and the process ends without taking the interpreter apart, which takes 50 ms.

    Exit handlers do not run, so the app must have closed what it opened.
    """
    status = _status(lambda: _call(app, name), NOTHING_KEPT)
    for stream in filter(None, (sys.stdout, sys.stderr)):
        with contextlib.suppress(OSError):
            stream.flush()
    os._exit(status)


def _call(app: typer.Typer, name: str) -> object:
    """What the app returns; ``--version`` alone says what a result of it depends on."""
    if sys.argv[1:] != ["--version"]:
        return app(prog_name=name, standalone_mode=False)
    from tsc_missing.versions import versions

    print(name, ", ".join(f"{key} {value}" for key, value in versions().items()))
    return DONE


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Once: who sends SIGTERM often sends it to the process and to its group."""
    signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


def _status(call: Callable[[], object], kept: str) -> int:
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        result = call()
        print(end="", flush=True)
    except UserError as error:
        _say(_by_its_option(error))
        return MISTAKE
    except typer.TyperException as error:
        _say(_in_words(error))
        return MISTAKE
    except (KeyboardInterrupt, typer.Abort):
        result = INTERRUPTED
    except BrokenPipeError:
        return FAILED
    except Exception as error:
        _say(f"{type(error).__name__}: {error}")
        messages().print_exception(max_frames=20)
        return FAILED
    if result == INTERRUPTED:
        _say(f"interrupted; {kept}")
    return result if isinstance(result, int) else DONE


def _by_its_option(error: UserError) -> str:
    """The error's words; a field that an option of the command line set goes by the option."""
    given = {word.partition("=")[0] for word in sys.argv}
    names = (f"--{error.field.replace('_', '-')}", OTHER_NAMES.get(error.field))
    option = next((name for name in names if name in given), error.field)
    return option + str(error).removeprefix(error.field)


def _in_words(error: typer.TyperException) -> str:
    """One line for what typer did not understand, with the value that it leaves out."""
    text = error.format_message() if hasattr(error, "format_message") else str(error)
    options = getattr(getattr(error, "param", None), "opts", ())
    given = [value for name, value in itertools.pairwise(sys.argv) if name in options]
    found = f" (found {given[-1]!r})" if given and given[-1] not in text else ""
    return " ".join(text.split()) + found


def _say(text: str) -> None:
    print(f"error: {text}", file=sys.stderr)
