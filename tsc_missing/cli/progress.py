"""The progress bar of a run: simulated time, vehicles, average travel time so far."""

from collections.abc import Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from tsc_missing.cli.common import messages
from tsc_missing.evaluation import closed_loop


@contextmanager
def progress_bar(horizon: int) -> Iterator[closed_loop.Watch]:
    """A bar on the error stream that is there while the block runs."""
    columns = (
        TextColumn("{task.fields[clock]}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TextColumn("{task.fields[state]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=messages(), transient=True) as bar:
        task = bar.add_task("", total=horizon, clock="00:00:00", state="")

        def watch(now: closed_loop.Progress) -> None:
            seconds = int(now.time)
            clock = f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"
            state = f"{now.running} driving, {now.waiting} waiting to enter, ATT {now.att:.0f} s"
            bar.update(task, completed=now.time, clock=clock, state=state)

        yield watch
