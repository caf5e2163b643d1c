"""From a command's options to settings, with errors that name the option."""

from typing import Annotated, Any, get_args

import typer
from pydantic import ValidationError

from tsc_missing.config import MissingSettings, RunSettings
from tsc_missing.errors import UserError, nearest

NetArgument = Annotated[
    str,
    typer.Argument(
        help="A network's name (jinan, hangzhou_2, …) or a network folder.",
        metavar="NET",
        show_default=False,
    ),
]

AdjacentOption = Annotated[
    bool, typer.Option(help="Kriging: blind one intersection and all its neighbours.")
]
LastingOption = Annotated[
    bool, typer.Option(help="Lane: broken movements are silent for the whole run.")
]
MeanOutageOption = Annotated[
    float, typer.Option(help="Burst, mixed: mean length of an outage in decision steps.")
]

OPTION_OF = {
    "pattern": "missing",
    "file": "mask",
    "kind": "sensor",
    "length": "detector_length",
    "nets": "net",
    "policies": "policy",
}


def make_settings(**values: Any) -> RunSettings:
    """The settings of a run; ``UserError`` names the option that is wrong."""
    try:
        return RunSettings.model_validate(values)
    except ValidationError as error:
        raise option_error(error) from None


def option_error(error: ValidationError, whole: str = "options") -> UserError:
    """The first thing that a model refused, with the option that set it.

    What is wrong with several fields together goes by ``whole``, the name of one of them, or by
    the field of their group that the words name first.
    """
    first = error.errors(include_url=False)[0]
    names = [part for part in first["loc"] if isinstance(part, str)]
    name = names[-1] if names else whole
    value = first["input"]
    if isinstance(value, dict):  # of a group, or of all: the option that the words name first
        words = str(first["msg"])
        named = [key for key in value if key in words]
        name = min(named, key=words.index, default=name)
        value = value.get(name, "it")
    option = OPTION_OF.get(name, name).replace("_", "-")
    return UserError(f"--{option}", value, _allowed(first))


def _allowed(problem: Any) -> str:
    """Words for what is allowed, with the nearest name where a name was wanted."""
    if problem["type"] == "literal_error":
        names = str(problem["ctx"]["expected"]).replace(" or ", ", ").replace("'", "").split(", ")
        wanted = set(names) - {"file"}  # a pattern that --mask names
        return nearest(str(problem["input"]), wanted)
    return str(problem["msg"]).removeprefix("Value error, ")


def check_replay(
    pattern: str, rate: float | None, mask_seed: int | None, adjacent: bool, lasting: bool
) -> None:
    """Raise ``UserError`` for what says how a mask is drawn, where one is read instead."""
    wanted = None if pattern == "none" else pattern
    for option, value in (("--rate", rate), ("--mask-seed", mask_seed), ("--missing", wanted)):
        if value is not None:
            raise UserError(option, value, "it cannot go with --mask, which draws nothing")
    for option, is_set in (("--adjacent", adjacent), ("--lasting", lasting)):
        if is_set:
            raise UserError(option, "set", "it cannot go with --mask, which draws nothing")


def missing_rate(
    pattern: str, rate: float | None, needed: bool = True, advice: str = "name it by --mask FILE"
) -> float:
    """The rate that goes with a pattern; ``needed`` says whether a pattern must have one.

    ``advice`` is what is said of the pattern file, which a file itself says.
    """
    if pattern == "file" and needed:
        raise UserError("--missing", pattern, advice)
    if pattern == "none" and rate:
        raise UserError("--rate", rate, "it needs a pattern of missing data: --missing NAME")
    known = get_args(MissingSettings.model_fields["pattern"].annotation)  # else it is told later
    if needed and pattern in known and pattern != "none" and rate is None:
        raise UserError("--rate", "nothing", f"--missing {pattern} needs a rate from 0 to 1")
    return rate or 0.0
