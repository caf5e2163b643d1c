"""What is logged of a training: ``metrics.csv``, and TensorBoard where it is installed."""

import csv
import importlib.util
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tsc_missing.files import replace_file

FILE = "metrics.csv"
COLUMNS = (
    "step",
    "wall_s",
    "loss",
    "diffusion",
    "inverse",
    "inverse_accuracy",
    "gradient_norm",
    "learning_rate",
    "windows_per_s",
)


class MetricsLog:
    """Appends rows; rows of steps after the one that a training goes on from are dropped."""

    def __init__(self, folder: Path, step: int, columns: Sequence[str] = COLUMNS) -> None:
        """``step`` is where the training stands; the first column is the step."""
        self._columns = columns
        self._path = folder / FILE
        rows = []
        if self._path.exists():
            with self._path.open(newline="", encoding="utf-8") as stream:
                rows = [row for row in csv.DictReader(stream) if self._up_to(row, step)]
        text = io.StringIO(newline="")
        writer = csv.DictWriter(text, columns)
        writer.writeheader()
        writer.writerows(rows)
        replace_file(self._path, text.getvalue().encode())
        self._board = _board(folder, step)

    def write(self, row: Mapping[str, float]) -> None:
        """Append a row with all columns."""
        with self._path.open("a", newline="", encoding="utf-8") as stream:
            shown = {name: f"{row[name]:.6g}" for name in self._columns if name != "step"}
            csv.DictWriter(stream, self._columns).writerow({"step": int(row["step"]), **shown})
        if self._board is not None:
            for name in self._columns[1:]:
                self._board.add_scalar(name, row[name], int(row["step"]))

    def close(self) -> None:
        """Finish what is buffered."""
        if self._board is not None:
            self._board.close()

    def _up_to(self, row: Mapping[str, str | None], step: int) -> bool:
        """Whether a row is whole and not after the step."""
        number = row.get("step")
        whole = all(row.get(name) for name in self._columns)
        return whole and number is not None and number.isdigit() and int(number) <= step


def _board(folder: Path, step: int) -> Any:
    if importlib.util.find_spec("tensorboard") is None:
        return None
    from torch.utils.tensorboard import SummaryWriter

    return SummaryWriter(str(folder / "tensorboard"), purge_step=step)
