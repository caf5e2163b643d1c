"""``tsc-collect``: behaviour policies to an offline dataset."""

from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import ValidationError

from tsc_missing.cli.common import FINISHED_KEPT, INTERRUPTED, make_app, messages, run_app
from tsc_missing.cli.options import (
    AdjacentOption,
    LastingOption,
    MeanOutageOption,
    missing_rate,
    option_error,
)
from tsc_missing.network.folder import bundled_profiles
from tsc_missing.offline.dataset import EPISODES, Dataset
from tsc_missing.offline.plan import CollectSettings
from tsc_missing.offline.policies import POLICIES

app = make_app("Collect an offline dataset: behaviour policies with exploration, in closed loop.")

DRAWN = "the holes of a log are drawn, by one of the other patterns"
DEFAULT = CollectSettings(nets=("jinan",))


@app.command()
def collect(
    out: Annotated[
        Path, typer.Option(help="The dataset's folder; what is there already is not run again.")
    ],
    net: Annotated[
        list[str] | None,
        typer.Option(help="A network's name or folder; repeatable. Default: all bundled datasets."),
    ] = None,
    episodes: Annotated[int, typer.Option(help="Runs, taking the networks in turn.")] = (
        DEFAULT.episodes
    ),
    demand: Annotated[
        str,
        typer.Option(
            help="profile: the bundled demand; recorded: what was imported, at volume 1; auto: the "
            "bundled demand if there is one, else the network's own."
        ),
    ] = DEFAULT.demand,
    volume_min: Annotated[float, typer.Option(help="Least volume of an episode.")] = (
        DEFAULT.volume_min
    ),
    volume_max: Annotated[float, typer.Option(help="Largest volume of an episode.")] = (
        DEFAULT.volume_max
    ),
    policy: Annotated[
        list[str] | None,
        typer.Option(
            help=f"A behaviour policy; repeatable. Default: {', '.join(DEFAULT.policies)}. "
            f"Also: {', '.join(sorted({*POLICIES} - {*DEFAULT.policies}))}, FILE.py:CLASS."
        ),
    ] = None,
    epsilon_min: Annotated[float, typer.Option(help="Least share of random decisions.")] = (
        DEFAULT.epsilon_min
    ),
    epsilon_max: Annotated[float, typer.Option(help="Largest share of random decisions.")] = (
        DEFAULT.epsilon_max
    ),
    switch: Annotated[
        float, typer.Option(help="Share of episodes that two policies decide in turn.")
    ] = DEFAULT.switch,
    unaware: Annotated[
        float, typer.Option(help="Largest share of intersections whose policy sees nothing.")
    ] = DEFAULT.unaware,
    neglect: Annotated[
        float, typer.Option(help="Share of these that neglect some movements, whatever comes.")
    ] = DEFAULT.neglect,
    lost: Annotated[
        list[str] | None,
        typer.Option(
            help="What the policies do not see: none, random, kriging, lane, burst or mixed, at "
            "rates drawn for each episode; repeatable, one a round over the networks. "
            "Default: none."
        ),
    ] = None,
    min_space: Annotated[
        int, typer.Option(help="Vehicles a lane that policies keep free on short roads; 0: none.")
    ] = DEFAULT.min_space,
    missing: Annotated[
        str, typer.Option(help="Holes of the log: none, random, kriging, lane, burst or mixed.")
    ] = DEFAULT.missing.pattern,
    rate: Annotated[
        float | None, typer.Option(help="Share of the log that is missing, 0 to 1.")
    ] = None,
    adjacent: AdjacentOption = DEFAULT.missing.adjacent,
    lasting: LastingOption = DEFAULT.missing.lasting,
    mean_outage: MeanOutageOption = DEFAULT.missing.mean_outage,
    horizon: Annotated[int, typer.Option(help="Simulated seconds of an episode.")] = (
        DEFAULT.horizon
    ),
    seed: Annotated[int, typer.Option(help="Seed of everything that is drawn.")] = DEFAULT.seed,
    workers: Annotated[int, typer.Option(min=1, help="Simulations at a time.")] = 2,
) -> None:
    """Collect an offline dataset: behaviour policies with exploration, in closed loop."""
    settings = _settings(
        nets=tuple(net or sorted(bundled_profiles())),
        demand=demand,
        volume_min=volume_min,
        volume_max=volume_max,
        policies=tuple(policy or DEFAULT.policies),
        epsilon_min=epsilon_min,
        epsilon_max=epsilon_max,
        switch=switch,
        unaware=unaware,
        neglect=neglect,
        lost=tuple(lost or DEFAULT.lost),
        min_space=min_space,
        missing={
            "pattern": missing,
            "rate": missing_rate(missing, rate, advice=DRAWN),
            "adjacent": adjacent,
            "lasting": lasting,
            "mean_outage": mean_outage,
        },
        horizon=horizon,
        episodes=episodes,
        seed=seed,
    )
    try:
        dataset = _watched(settings, out, workers)
    except KeyboardInterrupt:
        there = len(list((out / EPISODES).glob("[0-9]*.parquet")))
        messages().print(
            f"interrupted with {there} of {episodes} episodes; the same command goes on"
        )
        raise SystemExit(INTERRUPTED) from None
    _print(dataset)


def _settings(**values: Any) -> CollectSettings:
    try:
        return CollectSettings.model_validate(values)
    except ValidationError as error:
        raise option_error(error) from None


def _watched(settings: CollectSettings, out: Path, workers: int) -> Dataset:
    """Collect with a progress bar on the error stream."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
    from rich.progress import TimeRemainingColumn as Remaining

    from tsc_missing.offline.collect import collect as run

    columns = (TextColumn("episodes"), BarColumn(), MofNCompleteColumn(), Remaining())
    quiet = not messages().is_terminal
    with Progress(*columns, console=messages(), transient=True, disable=quiet) as bar:
        task = bar.add_task("", total=settings.episodes)

        def watch(done: int, wanted: int) -> None:
            bar.update(task, completed=done, total=wanted)

        return run(settings, out, workers, watch)


def _print(dataset: Dataset) -> None:
    manifest = dataset.manifest
    kind = "complete" if manifest.complete else "with holes"
    rows = sum(episode.steps * episode.intersections for episode in manifest.episodes)
    print(
        f"{dataset.path}: {len(manifest.episodes)} episodes {kind}, {rows} rows, "
        f"mean {manifest.statistics.mean_vehicles:.2f} vehicles and "
        f"{manifest.statistics.mean_queue:.2f} queueing a slot"
    )
    if not any(episode.statistics.cells for episode in manifest.episodes):
        messages().print("nothing is recorded in them: every sensor is among the missing ones")


def main() -> None:
    """The entry point of ``tsc-collect``."""
    run_app(app, "tsc-collect", FINISHED_KEPT)


if __name__ == "__main__":
    main()
