"""All figures of a report, with what they show in words."""

import io
from collections.abc import Iterator
from dataclasses import dataclass

from matplotlib import rc_context
from matplotlib.figure import Figure

from tsc_missing.report.figures import generalisation_figure, imputation_figure, rate_figure
from tsc_missing.report.loss_map import loss_maps
from tsc_missing.report.queue_map import map_runs, queue_map
from tsc_missing.report.queues import MINUTE, SMOOTH, queue_figure
from tsc_missing.report.results import Results


@dataclass(frozen=True)
class Picture:
    """A figure with its file name and what it shows in words."""

    name: str
    figure: Figure
    words: str


def pictures_of(results: Results, metric: str) -> Iterator[Picture]:
    """Those that the results have something to show for."""
    subject = "Travel time" if metric.startswith("att_") else metric
    rates, rate_words = rate_figure(results, metric) or (None, "")
    matrix, matrix_words = generalisation_figure(results, metric) or (None, "")
    queues, queue_words = queue_figure(results, metric) or (None, "")
    drawn: list[tuple[str, Figure | None, str]] = [
        ("missing-rate", rates, f"{subject} against the missing rate. {rate_words}"),
        (
            "generalisation",
            matrix,
            f"Weights trained at one missing rate and tested at another: {metric} divided by "
            "that of the weights trained at the tested rate. Above 1 is worse than these. "
            f"{matrix_words}",
        ),
        (
            "imputation",
            imputation_figure(results, metric),
            f"{subject} against the error of imputation, means over seeds; a larger marker is a "
            "larger missing rate. Methods that impute nothing are not shown.",
        ),
        (
            "queues",
            queues,
            "Vehicles in queues over time in the whole network, at the highest rate of each "
            "pattern of missing data, mean over seeds and a moving mean over "
            f"{SMOOTH / MINUTE:.0f} minutes (in short runs over a tenth of the run). {queue_words}",
        ),
    ]
    for run in map_runs(results, metric):
        words = (
            f"Mean queue of every road of {run.spec.dataset}, and which sensors are missing: "
            f"{run.spec.method}, the best of {run.spec.case}, at its first seed."
        )
        drawn.append((f"map-{run.spec.name}", queue_map(run), words))
    drawn.extend(loss_maps(results, metric))
    for name, figure, words in drawn:
        if figure is not None:
            yield Picture(name, figure, words.strip())


def render(figure: Figure, suffix: str) -> bytes:
    """A figure as a file's bytes (``png`` or ``svg``), the same ones every time."""
    stream = io.BytesIO()
    with rc_context({"svg.hashsalt": "tsc-missing", "svg.fonttype": "path"}):
        metadata = {"Date": None} if suffix == "svg" else None
        figure.savefig(stream, format=suffix, metadata=metadata)
    return stream.getvalue()
