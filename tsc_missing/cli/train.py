"""``tsc-train``: a dataset to weights."""

import importlib.util
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Annotated, Any

import typer

from tsc_missing.cli.common import FAILED, INTERRUPTED, make_app, messages, run_app
from tsc_missing.errors import UserError

app = make_app("Train the diffusion controller on an offline dataset.")


@app.command()
def train(
    config: Annotated[str, typer.Argument(help="A TOML file, or a bundled one: universal.")],
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with a training that was stopped.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(help="The training's folder. Default: runs/train-<name of the config>."),
    ] = None,
    data: Annotated[
        Path | None, typer.Option(help="The dataset's folder, instead of the config's.")
    ] = None,
    steps: Annotated[int | None, typer.Option(help="Steps, instead of the config's.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed, instead of the config's.")] = None,
) -> None:
    """Train the diffusion controller; Ctrl-C saves, and --resume goes on."""
    _check_torch()
    # Waiting threads that spin make a step several times slower where a core is shared.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    from tsc_missing.diffusion.memory import keep_freed_memory
    from tsc_missing.offline.dataset import read_dataset
    from tsc_missing.training.config import find_config, read_training
    from tsc_missing.training.loop import DivergedError, StoppedError, Training

    changes = {"data": data, "steps": steps, "seed": seed}
    settings = read_training(config, **{k: v for k, v in changes.items() if v is not None})
    folder = out if out is not None else Path("runs") / f"train-{find_config(config).stem}"
    keep_freed_memory()
    training = Training(settings, read_dataset(settings.data), folder, resume)
    try:
        weights = _watched(training)
    except StoppedError as stopped:
        messages.print(
            f"interrupted; saved at step {stopped.step} in {folder}, --resume goes on", markup=False
        )
        raise SystemExit(INTERRUPTED) from None
    except DivergedError as error:
        messages.print(f"error: {error}", markup=False)
        raise SystemExit(FAILED) from None
    print(weights)


def _check_torch() -> None:
    for name in ("torch", "safetensors"):
        if importlib.util.find_spec(name) is None:
            raise UserError(name, "nothing", "tsc-train needs it: pip install torch safetensors")


@contextmanager
def _asked_to_stop() -> Iterator[list[bool]]:
    """A list that gets an entry at Ctrl-C or SIGTERM; the second Ctrl-C interrupts at once."""
    asked: list[bool] = []

    def note(number: int, frame: FrameType | None) -> None:
        asked.append(True)
        if len(asked) > 1:
            raise KeyboardInterrupt

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _watched(training: Any) -> Path:
    """Train with a progress bar on the error stream, where that is a terminal."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    from tsc_missing.training.loop import Seen

    columns = (
        TextColumn("step {task.completed:.0f}/{task.total:.0f}"),
        BarColumn(),
        TextColumn("{task.fields[state]}"),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    quiet = not messages.is_terminal
    with (
        _asked_to_stop() as asked,
        Progress(*columns, console=messages, transient=True, disable=quiet) as bar,
    ):
        task = bar.add_task(
            "", total=training.settings.steps, completed=training.step, state="loading"
        )

        def watch(now: Seen) -> None:
            state = (
                f"loss {now.loss:.4f}, phases {now.inverse_accuracy:.0%}, "
                f"{now.windows_per_second:.0f} windows/s"
            )
            bar.update(task, completed=now.step, state=state)

        weights: Path = training.run(watch, lambda: bool(asked))
        return weights


def main() -> None:
    """The entry point of ``tsc-train``."""
    run_app(app, "tsc-train")


if __name__ == "__main__":
    main()
