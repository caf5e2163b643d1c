"""``tsc-run``: one closed-loop run."""

import contextlib
import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from tsc_missing.cli.common import make_app, run_app_and_leave
from tsc_missing.cli.default_folder import default_folder
from tsc_missing.cli.options import (
    AdjacentOption,
    LastingOption,
    MeanOutageOption,
    check_replay,
    make_settings,
    missing_rate,
)
from tsc_missing.config import (
    BELIEF_STEPS,
    BLIND_STEPS,
    GUIDED_STEPS,
    MIN_SPACE,
    MIN_SPACE_AHEAD,
    RunSettings,
)
from tsc_missing.evaluation.metrics import Result
from tsc_missing.evaluation.run import Options, Prepared, describe, execute, prepare
from tsc_missing.files import check_writable
from tsc_missing.simulation.engine import EngineName

app = make_app("Run one simulation in closed loop, with sensors missing, and account for it.")

DEFAULT = RunSettings()


@app.command()
def run(
    net: Annotated[
        str, typer.Option(help="A network's name (jinan, hangzhou_2, …) or a network folder.")
    ] = DEFAULT.net,
    demand: Annotated[
        str,
        typer.Option(
            help="profile: the bundled demand; recorded: what was imported; auto: the "
            "bundled demand if there is one, else the network's own."
        ),
    ] = DEFAULT.demand,
    volume: Annotated[
        float, typer.Option(help="Scales the arrivals of a profile.")
    ] = DEFAULT.volume,
    controller: Annotated[
        str,
        typer.Option(
            help="Who decides: difflight, max-queue, fixed-time, … (a wrong name lists all). "
            "FILE.py:CLASS: your own."
        ),
    ] = DEFAULT.controller,
    imputer: Annotated[
        str,
        typer.Option(
            help="What fills the holes for controllers that need values: sfm-4, sfm, last, mean or "
            "diffusion. FILE.py:CLASS: your own."
        ),
    ] = DEFAULT.imputer,
    blind: Annotated[
        str,
        typer.Option(
            help="What runs at intersections without a sensor: auto, fixed-time, clustered, "
            "familiar, alone, expected-queue or none."
        ),
    ] = DEFAULT.blind,
    weights: Annotated[
        str, typer.Option(help="Diffusion: a name of packaged weights, or a path.")
    ] = DEFAULT.diffusion.weights,
    sampling_steps: Annotated[
        int | None,
        typer.Option(
            help="Diffusion: reverse steps a decision.",
            show_default=f"{BELIEF_STEPS}, at intersections without a sensor {BLIND_STEPS}; "
            f"{GUIDED_STEPS} where rewards guide the plan",
        ),
    ] = DEFAULT.diffusion.sampling_steps,
    samples: Annotated[
        int,
        typer.Option(
            help="Scoring value: how many possible states of an unseen intersection are drawn."
        ),
    ] = DEFAULT.diffusion.samples,
    scoring: Annotated[
        str,
        typer.Option(
            help="difflight: what scores phases: inverse, queue, mixed, value or horizon."
        ),
    ] = DEFAULT.diffusion.scoring,
    q_weights: Annotated[
        str,
        typer.Option(
            "--policy-weights",
            "--q-weights",
            help="Weights of a learned controller or of scoring value: a name or a path. Scoring "
            "value takes several, by commas: the others have a say where nothing is known.",
        ),
    ] = DEFAULT.q_weights,
    missing: Annotated[
        str, typer.Option(help="none, random, kriging, lane, burst or mixed.")
    ] = DEFAULT.missing.pattern,
    rate: Annotated[
        float | None, typer.Option(help="Share of the data that is missing, 0 to 1.")
    ] = None,
    adjacent: AdjacentOption = DEFAULT.missing.adjacent,
    lasting: LastingOption = DEFAULT.missing.lasting,
    mean_outage: MeanOutageOption = DEFAULT.missing.mean_outage,
    mask: Annotated[
        Path | None,
        typer.Option(help="What is missing: the mask.npz of another run, or a CSV of outages."),
    ] = None,
    turning_counts: Annotated[
        str,
        typer.Option(help="That controllers are told. run: of this very run; none: no counts."),
    ] = DEFAULT.turning_counts,
    count_error: Annotated[
        float,
        typer.Option(
            help="How wrong these turning counts are: the standard deviation of their "
            "logarithm, 0.3 for about 30 %."
        ),
    ] = DEFAULT.count_error,
    seed: Annotated[int, typer.Option(help="Seed of demand, mask and controller.")] = DEFAULT.seed,
    mask_seed: Annotated[
        int | None, typer.Option(help="Seed of the mask alone.", show_default="that of --seed")
    ] = None,
    horizon: Annotated[int, typer.Option(help="Simulated seconds.")] = DEFAULT.horizon,
    sensor: Annotated[
        str, typer.Option(help="lane: the whole lane; area: its last metres.")
    ] = DEFAULT.sensor.kind,
    detector_length: Annotated[
        float, typer.Option(help="Metres that an area detector covers.")
    ] = DEFAULT.sensor.length,
    decision_interval: Annotated[
        int, typer.Option(help="Seconds between decisions.")
    ] = DEFAULT.signals.decision_interval,
    yellow: Annotated[
        int | None,
        typer.Option(
            help="Seconds of yellow at a change of phase.",
            show_default=f"{DEFAULT.signals.yellow}, or the network's own",
        ),
    ] = None,
    all_red: Annotated[
        int, typer.Option(help="Seconds of all-red after the yellow.")
    ] = DEFAULT.signals.all_red,
    min_green: Annotated[
        int | None,
        typer.Option(
            help="Seconds that a green lasts at least.",
            show_default=f"{DEFAULT.signals.min_green}, or the network's own",
        ),
    ] = None,
    max_red: Annotated[
        int,
        typer.Option(
            help="Seconds that somebody may wait at a red before it ends, whatever the controller "
            "says; fixed plans stay as they are. 0: no bound."
        ),
    ] = DEFAULT.signals.max_red,
    min_space: Annotated[
        int | None,
        typer.Option(
            help="A road between intersections that has room for fewer than so many more vehicles "
            "on a lane gets green first. 0: none; fixed plans stay as they are.",
            show_default=f"{MIN_SPACE_AHEAD} for rolling-horizon and difflight, by values "
            f"{MIN_SPACE}, else 0",
        ),
    ] = DEFAULT.signals.min_space,
    gui: Annotated[bool, typer.Option("--gui", help="Watch it in sumo-gui.")] = False,
    out: Annotated[
        Path | None, typer.Option(help="The run folder to write. Default: a new one in runs/")
    ] = None,
    decisions: Annotated[bool, typer.Option(help="Write decisions.parquet.")] = True,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object and nothing else.")
    ] = False,
) -> None:
    """Run one simulation in closed loop, with sensors missing, and account for it."""
    if mask is not None:
        check_replay(missing, rate, mask_seed, adjacent, lasting)
    settings = make_settings(
        net=net,
        demand=demand,
        volume=volume,
        controller=controller,
        imputer=imputer,
        blind=blind,
        diffusion={
            "weights": weights,
            "sampling_steps": sampling_steps,
            "samples": samples,
            "scoring": scoring,
        },
        q_weights=q_weights,
        missing={
            "pattern": missing if mask is None else "file",
            "rate": missing_rate(missing, rate, needed=mask is None),
            "adjacent": adjacent,
            "lasting": lasting,
            "mean_outage": mean_outage,
            "file": "" if mask is None else str(mask),
        },
        sensor={"kind": sensor, "length": detector_length},
        signals={
            "decision_interval": decision_interval,
            "all_red": all_red,
            "max_red": max_red,
            "min_space": min_space,
            **({} if yellow is None else {"yellow": yellow}),
            **({} if min_green is None else {"min_green": min_green}),
        },
        turning_counts=turning_counts,
        count_error=count_error,
        seed=seed,
        mask_seed=mask_seed,
        horizon=horizon,
    )
    engine: EngineName = "gui" if gui else "libsumo"
    with default_folder(settings) if out is None else contextlib.nullcontext(out) as folder:
        check_writable(folder, "out")
        prepared = prepare(settings, Options(folder, decisions, engine))
        result = _watched(prepared, quiet=as_json)
    if as_json:
        json.dump({**describe(prepared, result), "out": str(folder)}, sys.stdout)
        sys.stdout.write("\n")
    else:
        _print_result(prepared, result, folder)


def _watched(prepared: Prepared, quiet: bool) -> Result:
    """Run it with a progress bar where there is a terminal to show it on."""
    if quiet or not sys.stderr.isatty():
        return execute(prepared)
    from tsc_missing.cli.progress import progress_bar

    with progress_bar(prepared.settings.horizon) as watch:
        return execute(prepared, watch)


def _print_result(prepared: Prepared, result: Result, folder: Path) -> None:
    from tsc_missing.cli.result_table import print_result

    print_result(prepared, result, folder)


def main() -> None:
    """The entry point of ``tsc-run``."""
    run_app_and_leave(app, "tsc-run")


if __name__ == "__main__":
    main()
