"""The progress of a batch: runs done, running and failed, and the time left."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
from rich.progress import TimeRemainingColumn as Remaining
from rich.text import Text

from tsc_missing.batch.run import State, Watch
from tsc_missing.cli.common import messages


class _StateColumn(ProgressColumn):
    """What the runs are doing now, asked for whenever the bar is drawn."""

    max_refresh = 0.5

    def __init__(self) -> None:
        super().__init__()
        self.state: Callable[[], State] | None = None

    def render(self, task: Task) -> Text:
        return Text(words(self.state()) if self.state is not None else "")


def words(state: State) -> str:
    """For example ``12 of 40 done, 2 running, 1 failed``."""
    failed = f", {state.failed} failed" if state.failed else ""
    return f"{state.done} of {state.wanted} done, {state.running} running{failed}"


@contextmanager
def batch_progress() -> Iterator[Watch]:
    """A bar on the error stream; where that is no terminal, a line for every run that ends."""
    column = _StateColumn()
    columns = (BarColumn(), column, TextColumn("left:"), Remaining())
    quiet = not messages().is_terminal
    with Progress(*columns, console=messages(), transient=True, disable=quiet) as bar:
        task = bar.add_task("")

        def watch(ask: Callable[[], State]) -> None:
            column.state, now = ask, ask()
            bar.update(task, total=now.wanted, completed=now.done + now.failed)
            last = now.last
            if last is not None and (quiet or last.failure is not None):
                failure = last.failure
                end = f"failed: {failure.error}" if failure else f"{last.seconds:.0f} s"
                messages().print(f"{words(now)}: {last.name}, {end}", markup=False)

        yield watch
