"""The controllers by name, and what is to be known of one by its name."""

from collections.abc import Callable

from tsc_missing.baselines.config import SETTINGS as BASELINES
from tsc_missing.config import DiffusionSettings
from tsc_missing.controllers.advanced_max_pressure import AdvancedMaxPressure
from tsc_missing.controllers.base import Controller
from tsc_missing.controllers.diffusion_weights import DIFFLIGHT_PAPER
from tsc_missing.controllers.expected_queue import ExpectedQueue
from tsc_missing.controllers.fixed_time import FixedTime, PlainCycle
from tsc_missing.controllers.max_pressure import MaxPressure
from tsc_missing.controllers.max_queue import MaxQueue
from tsc_missing.controllers.own import FIELD
from tsc_missing.controllers.random_phases import RandomPhases
from tsc_missing.controllers.rolling_horizon import NAME as ROLLING_HORIZON
from tsc_missing.controllers.rolling_horizon import RollingHorizon
from tsc_missing.errors import UserError, nearest
from tsc_missing.own_code import is_own, own_class
from tsc_missing.simulation.native import AS_BUILT, KINDS, RECALL

FULL_INFORMATION = (*KINDS, AS_BUILT)  # SUMO's own programs, for which nothing is ever missing,
NATIVE = (RECALL, *FULL_INFORMATION)  # and all of them: names for comparisons, not controllers

CONTROLLERS: dict[str, Callable[[], Controller]] = {
    "advanced-max-pressure": AdvancedMaxPressure,
    "expected-queue": ExpectedQueue,
    "fixed-time": FixedTime,
    "fixed-time-15": lambda: PlainCycle(15.0),
    "fixed-time-30": lambda: PlainCycle(30.0),
    "max-pressure": MaxPressure,
    "max-queue": MaxQueue,
    "random": RandomPhases,
    ROLLING_HORIZON: RollingHorizon,
}

# Apart from the others, because they need weights:
DIFFLIGHT = "difflight"
LEARNED = ("advanced-colight", "attendlight", "efficient-colight")
VALUE = "value"  # a Q-network that is a behaviour policy, and what lookahead improves


def require_controller(name: str) -> None:
    """Raise ``UserError`` with the nearest name where there is no controller of this name."""
    if is_own(name):
        own_class(name, FIELD, Controller)
    elif name not in (DIFFLIGHT, DIFFLIGHT_PAPER, *CONTROLLERS, *LEARNED, *BASELINES):
        known = [*CONTROLLERS, *LEARNED, *BASELINES, DIFFLIGHT, DIFFLIGHT_PAPER, *NATIVE]
        raise UserError(FIELD, name, nearest(name, known))


def is_learned(name: str) -> bool:
    """Whether it is a policy with weights of its own that decides on complete values."""
    return name in LEARNED or name in BASELINES


def needs_values(name: str) -> bool:
    """Whether the controller of this name sees observations through an imputer."""
    if is_own(name):
        found = own_class(name, FIELD, Controller).needs_values
        if not isinstance(found, bool):
            raise UserError(FIELD, name, "its needs_values must be True or False, on the class")
        return found
    return is_learned(name) or (name in CONTROLLERS and CONTROLLERS[name]().needs_values)


def looks_at_nothing(name: str) -> bool:
    """Whether no sensor of ours matters to it: a fixed plan, or a program of SUMO's."""
    if name == ROLLING_HORIZON:
        return False
    return name in FULL_INFORMATION or (
        name in CONTROLLERS and not CONTROLLERS[name]().needs_values
    )


def by_model(name: str, diffusion: DiffusionSettings) -> bool:
    """Whether it plans on a traffic model, which goes on where no sensor reports."""
    return name == ROLLING_HORIZON or (name == DIFFLIGHT and diffusion.scoring == "horizon")


def by_value(name: str, diffusion: DiffusionSettings) -> bool:
    """Whether it is DiffLight that decides by the values of a Q-network."""
    return name == DIFFLIGHT and diffusion.scoring == "value"
