"""``tsc-train``: a dataset to weights."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from tsc_missing.cli.common import FAILED, INTERRUPTED, make_app, messages, run_app
from tsc_missing.errors import UserError, nearest
from tsc_missing.paths import bundled_trainings

if TYPE_CHECKING:  # torch takes seconds
    from tsc_missing.baselines.config import BaselineSettings
    from tsc_missing.lookahead.config import LookaheadSettings
    from tsc_missing.qlearning.config import QLearningSettings
    from tsc_missing.training.config import TrainingSettings

WORKERS = 2

app = make_app(
    "Train the diffusion controller or a baseline on logs, or a Q-network in the closed loop."
)


@app.command()
def train(
    config: Annotated[
        str | None,
        typer.Argument(help="A TOML file, or a bundled one by its name: universal, value, bc, …"),
    ] = None,
    algorithm: Annotated[
        str | None, typer.Option(help="The bundled config of this name, instead of CONFIG.")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with a training that was stopped.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            help="The training's folder. Default: runs/train-<name of the config>, for a baseline "
            "runs/train-<name of the config>-<name of the data>."
        ),
    ] = None,
    data: Annotated[
        list[Path] | None,
        typer.Option(
            help="The dataset's folder, instead of the config's. Diffusion: repeatable, to learn "
            "from several as one."
        ),
    ] = None,
    steps: Annotated[
        int | None, typer.Option(help="Diffusion, baselines: steps, instead of the config's.")
    ] = None,
    rounds: Annotated[
        int | None, typer.Option(help="Q-learning: rounds, instead of the config's.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed, instead of the config's.")] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            min=1, help=f"Q-learning, lookahead: simulations at a time. Default: {WORKERS}."
        ),
    ] = None,
) -> None:
    """Train the diffusion controller, a baseline or a Q-network.

    Ctrl-C saves, and --resume goes on.
    """
    from tsc_missing.baselines.config import BaselineSettings
    from tsc_missing.lookahead.config import LookaheadSettings
    from tsc_missing.qlearning.config import QLearningSettings
    from tsc_missing.training.config import find_config, read_training

    name = _config(config, algorithm)
    one = data[0] if data and len(data) == 1 else data
    changes = {"data": one, "steps": steps, "rounds": rounds, "seed": seed}
    settings = read_training(name, **{k: v for k, v in changes.items() if v is not None})
    simulates = isinstance(settings, LookaheadSettings | QLearningSettings)
    if workers is not None and not simulates:
        raise UserError("workers", workers, f"the training {name} simulates nothing")
    parts = ["train", find_config(name).stem]
    if isinstance(settings, BaselineSettings):
        parts.append(settings.data.resolve().name)
    folder = out if out is not None else Path("runs", "-".join(parts))
    if isinstance(settings, LookaheadSettings):
        print(_look_ahead(settings, folder, resume, workers or WORKERS))
    elif isinstance(settings, QLearningSettings):
        print(_learn(settings, folder, resume, workers or WORKERS))
    elif isinstance(settings, BaselineSettings):
        print(_imitate(settings, folder, resume))
    else:
        print(_fit(settings, folder, resume))


def _config(config: str | None, algorithm: str | None) -> str:
    if algorithm is not None and algorithm not in bundled_trainings():
        raise UserError("--algorithm", algorithm, nearest(algorithm, bundled_trainings()))
    if config is not None and algorithm is not None:
        raise UserError("--algorithm", algorithm, "CONFIG says it already: give one of them")
    name = config or algorithm
    if name is None:
        raise UserError("config", "nothing", f"a file, or of {', '.join(bundled_trainings())}")
    return name


def _fit(settings: "TrainingSettings", folder: Path, resume: bool) -> Path:
    """Train the diffusion model."""
    from tsc_missing.diffusion.memory import keep_freed_memory
    from tsc_missing.offline.joined import read_datasets
    from tsc_missing.training.loop import Training

    keep_freed_memory()
    training = Training(settings, read_datasets(settings.data), folder, resume)
    with _ending(folder), _progress(settings.steps, training.step, "step") as (show, stop):
        return training.run(
            lambda now: show(
                now.step,
                f"loss {now.loss:.4f}, phases {now.inverse_accuracy:.0%}, "
                f"{now.windows_per_second:.0f} windows/s",
            ),
            stop,
        )


def _imitate(settings: "BaselineSettings", folder: Path, resume: bool) -> Path:
    """Train a baseline."""
    import torch

    from tsc_missing.baselines.loop import BaselineTraining
    from tsc_missing.diffusion.memory import keep_freed_memory
    from tsc_missing.offline.dataset import read_dataset

    torch.set_num_threads(1)
    keep_freed_memory()
    training = BaselineTraining(settings, read_dataset(settings.data), folder, resume)
    with _ending(folder), _progress(settings.steps, training.step, "step") as (show, stop):
        return training.run(
            lambda now: show(
                now.step, ", ".join(f"{name} {value:.3g}" for name, value in now.logged.items())
            ),
            stop,
        )


@contextmanager
def _ending(folder: Path) -> Iterator[None]:
    """What a training that stops early or diverges says, and with which status it ends."""
    from tsc_missing.training.diverged import DivergedError
    from tsc_missing.training.steps import StoppedError

    try:
        yield
    except StoppedError as stopped:
        _interrupted(f"step {stopped.step}", folder)
    except DivergedError as error:
        messages().print(f"error: {error}", markup=False)
        raise SystemExit(FAILED) from None


def _learn(settings: "QLearningSettings", folder: Path, resume: bool, workers: int) -> Path:
    """Train a Q-network."""
    import torch

    from tsc_missing.qlearning.online import QTraining

    torch.set_num_threads(1)
    training = QTraining(settings, folder, resume)
    with _ending(folder), _progress(settings.rounds, training.round, "round") as (show, stop):
        weights = training.run(
            workers,
            lambda now: show(now.round, f"loss {now.loss:.4f}, {now.vehicles:.0f} vehicles"),
            stop,
        )
    if weights is None:
        _interrupted(f"round {training.round}", folder)
    return weights


def _look_ahead(settings: "LookaheadSettings", folder: Path, resume: bool, workers: int) -> Path:
    """Train a Q-network on what its phases lead to."""
    import torch

    from tsc_missing.lookahead.training import LookaheadTraining

    torch.set_num_threads(1)
    training = LookaheadTraining(settings, folder, resume)
    with _ending(folder), _progress(settings.episodes, training.there, "episode") as (show, stop):
        weights = training.run(workers, show, stop)
    if weights is None:
        _interrupted(f"episode {training.there}", folder)
    return weights


def _interrupted(at: str, folder: Path) -> NoReturn:
    messages().print(f"interrupted; saved at {at} in {folder}, --resume goes on", markup=False)
    raise SystemExit(INTERRUPTED) from None


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


Show = Callable[[int, str], None]


@contextmanager
def _progress(total: int, done: int, unit: str) -> Iterator[tuple[Show, Callable[[], bool]]]:
    """A progress bar on the error stream, where that is a terminal, and who says when to stop."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn(unit + " {task.completed:.0f}/{task.total:.0f}"),
        BarColumn(),
        TextColumn("{task.fields[state]}"),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    quiet = not messages().is_terminal
    with (
        _asked_to_stop() as asked,
        Progress(*columns, console=messages(), transient=True, disable=quiet) as bar,
    ):
        task = bar.add_task("", total=total, completed=done, state="loading")

        def show(completed: int, state: str) -> None:
            bar.update(task, completed=completed, state=state)

        yield show, lambda: bool(asked)


def main() -> None:
    """The entry point of ``tsc-train``."""
    run_app(app, "tsc-train", "what was saved before, if anything, stays; --resume goes on")


if __name__ == "__main__":
    main()
