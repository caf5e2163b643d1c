"""``tsc-check``: whether a controller or imputer of one's own keeps the rules."""

import sys
from collections.abc import Callable
from typing import Annotated

import typer

from tsc_missing.cli.common import DONE, FAILED, make_app, run_app
from tsc_missing.config import RunSettings

app = make_app("Check that a controller or an imputer of your own keeps the rules.")

DEFAULT = RunSettings()
FIELD = "CLASS"


@app.command()
def check(
    name: Annotated[
        str, typer.Argument(metavar=FIELD, help="FILE.py:CLASS, or MODULE:CLASS if installed.")
    ],
    net: Annotated[
        str, typer.Option(help="The network to try it on: a name or a network folder.")
    ] = DEFAULT.net,
) -> int:
    """Check that a controller or an imputer of your own keeps the rules.

    It is fed made-up observations with holes: docs/controllers.md says what is looked at.
    """
    from tsc_missing.evaluation.scenario import find_scenario

    what, trial = _trial(name)
    scenario = find_scenario(net, DEFAULT.demand)
    try:
        trial(scenario.folder.network)
    except AssertionError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return FAILED
    print(f"{name}: {what} that keeps the rules (tried on {scenario.name})")
    return DONE


def _trial(name: str) -> "tuple[str, Callable[..., None]]":
    """What it is in words, and what tries it on a network."""
    from tsc_missing.controllers.base import Controller
    from tsc_missing.controllers.check import check_controller
    from tsc_missing.controllers.registry import make_controller
    from tsc_missing.imputation.base import Imputer
    from tsc_missing.imputation.check import check_imputer
    from tsc_missing.imputation.registry import make_imputer
    from tsc_missing.own_code import own_class

    found = own_class(name, FIELD, Controller, Imputer)
    if issubclass(found, Controller):

        def make() -> Controller:
            return make_controller(name, DEFAULT.imputer, "none")

        return "a controller", lambda network: check_controller(make, network)
    return "an imputer", lambda network: check_imputer(lambda: make_imputer(name), network)


def main() -> None:
    """The entry point of ``tsc-check``."""
    run_app(app, "tsc-check")


if __name__ == "__main__":
    main()
