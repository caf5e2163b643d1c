"""Controllers by name, composed with an imputer and a rule for blind intersections."""

from collections.abc import Callable
from dataclasses import dataclass

from tsc_missing.baselines.config import SETTINGS as BASELINES
from tsc_missing.baselines.config import train_command
from tsc_missing.config import MIN_SPACE, DiffusionSettings, RunSettings
from tsc_missing.controllers.advanced_max_pressure import AdvancedMaxPressure
from tsc_missing.controllers.base import Controller
from tsc_missing.controllers.blind import Blind
from tsc_missing.controllers.difflight import DiffLight, is_guided
from tsc_missing.controllers.diffusion_weights import DIFFLIGHT_PAPER, diffusion_of
from tsc_missing.controllers.expected_queue import ExpectedQueue
from tsc_missing.controllers.fixed_time import FixedTime, PlainCycle
from tsc_missing.controllers.max_pressure import MaxPressure
from tsc_missing.controllers.max_queue import MaxQueue
from tsc_missing.controllers.max_red import MaxRed
from tsc_missing.controllers.random_phases import RandomPhases
from tsc_missing.controllers.spillback import Spillback
from tsc_missing.errors import UserError, nearest
from tsc_missing.imputation.base import Imputed
from tsc_missing.imputation.registry import DIFFUSION, check_imputer, make_imputer
from tsc_missing.network.folder import network_name
from tsc_missing.simulation.native import AS_BUILT, KINDS
from tsc_missing.weights.find import FIELD, find_weights, packaged_weights

NATIVE = (*KINDS, AS_BUILT)  # SUMO's own programs: names for comparisons, not controllers


@dataclass(frozen=True)
class Entry:
    """A controller that can be had by name.

    ``needs_values``: it decides on complete values, so it is composed with an imputer and, where
    there is nothing to impute from, with the rule for blind intersections.
    """

    make: Callable[[], Controller]
    needs_values: bool


CONTROLLERS: dict[str, Entry] = {
    "advanced-max-pressure": Entry(AdvancedMaxPressure, needs_values=True),
    "expected-queue": Entry(ExpectedQueue, needs_values=False),
    "fixed-time": Entry(FixedTime, needs_values=False),
    "fixed-time-15": Entry(lambda: PlainCycle(15.0), needs_values=False),
    "fixed-time-30": Entry(lambda: PlainCycle(30.0), needs_values=False),
    "max-pressure": Entry(MaxPressure, needs_values=True),
    "max-queue": Entry(MaxQueue, needs_values=True),
    "random": Entry(RandomPhases, needs_values=False),
}

# Apart from the others, because they need weights:
DIFFLIGHT = "difflight"
LEARNED = ("advanced-colight", "attendlight", "efficient-colight")
VALUE = "value"  # a Q-network that is a behaviour policy, and what lookahead improves
LOOKAHEAD = "lookahead"  # the weights of the scoring "value"

LONG_SILENCE = 40  # [decision steps] 10 minutes: readings lost at random come back before

BLIND: dict[str, Callable[[Controller], Controller]] = {
    "none": lambda controller: controller,
    "expected-queue": lambda controller: Blind(controller, ExpectedQueue()),
    "fixed-time": lambda controller: Blind(controller, FixedTime()),
    "clustered": lambda controller: Blind(controller, FixedTime(), LONG_SILENCE, clustered=True),
}


def weights_of(settings: RunSettings) -> tuple[str, ...]:
    """The names or paths of the weights that a run's controller and imputer use; often none."""
    name, q_weights = settings.controller, settings.q_weights
    diffusion = diffusion_of(settings).weights
    if name == DIFFLIGHT_PAPER:
        return (diffusion,)
    if name == DIFFLIGHT:
        value = (LOOKAHEAD if q_weights == "auto" else q_weights,)
        return (diffusion, *(value if by_value(name, settings.diffusion) else ()))
    learned = name in (*LEARNED, *BASELINES)
    found = (policy_weights(name, q_weights, settings.net),) if learned else ()
    fills = bool(found) or (name in CONTROLLERS and CONTROLLERS[name].needs_values)
    imputer = (diffusion,) if fills and settings.imputer == DIFFUSION else ()
    return (*found, *imputer)


def policy_weights(controller: str, q_weights: str, net: str) -> str:
    """The name or path of the weights of a learned policy on a network.

    Packaged weights of Q-networks are for any network and called as the controller; those of
    baselines are for one network each and called ``<controller>-<network>``. In a name or path of
    one's own ``{net}`` stands for the network.
    """
    if q_weights != "auto":
        return q_weights.replace("{net}", network_name(net))
    return f"{controller}-{network_name(net)}" if controller in BASELINES else controller


def by_value(controller: str, diffusion: DiffusionSettings) -> bool:
    """Whether it is DiffLight that decides by the values of a Q-network."""
    return controller == DIFFLIGHT and diffusion.scoring == "value"


def uses_weights(settings: RunSettings) -> bool:
    """Whether the run's controller, or the imputer that it is composed with, is a trained model."""
    return bool(weights_of(settings))


def make_controller(
    name: str,
    imputer: str,
    blind: str,
    diffusion: DiffusionSettings | None = None,
    q_weights: str = "auto",
    max_red: int = 0,
    net: str = "",
    min_space: int = 0,
) -> Controller:
    """The controller ``name``; if it needs values, with an imputer and the rule ``blind``.

    Where it decides on values ``Spillback`` keeps ``min_space`` [vehicles a lane] free, and
    ``MaxRed`` bounds its reds by ``max_red`` [s], which has the last word, each if it is not 0;
    fixed plans are left as they are.
    The rule "auto" is the fixed cycle; but none with the diffusion imputer, which knows what its
    values at blind intersections come from, and for ``difflight-paper``; and for ``difflight`` by
    values the fixed cycle only where two adjacent intersections are blind, without a sensor or for
    ``LONG_SILENCE``.
    ``q_weights`` are those of a learned policy, a name or a path; "auto" are packaged ones, of
    baselines those for the network ``net``. Raises ``UserError`` for names that are unknown and
    for weights that cannot be used.
    """
    if name not in (DIFFLIGHT, DIFFLIGHT_PAPER, *CONTROLLERS, *LEARNED, *BASELINES):
        known = [*CONTROLLERS, *LEARNED, *BASELINES, DIFFLIGHT, DIFFLIGHT_PAPER, *NATIVE]
        raise UserError("controller", name, nearest(name, known))
    diffusion = diffusion or DiffusionSettings()
    if blind == "auto":
        blind = _blind_rule(name, imputer, diffusion)
    if blind not in BLIND:
        raise UserError("blind", blind, nearest(blind, BLIND))
    check_imputer(imputer)
    if name == DIFFLIGHT:
        decides = _difflight(diffusion, q_weights)
        return BLIND[blind](bounded(roomy(decides, min_space), max_red))
    if name == DIFFLIGHT_PAPER:
        decides = _published(diffusion)
        return BLIND[blind](bounded(roomy(decides, min_space), max_red))
    entry = CONTROLLERS.get(name) or Entry(lambda: _learned(name, q_weights, net), True)
    if not entry.needs_values:
        return entry.make()
    imputed = Imputed(make_imputer(imputer, diffusion), entry.make())
    return BLIND[blind](bounded(roomy(imputed, min_space), max_red))


def controller_of(settings: RunSettings) -> Controller:
    """The controller of a run; raises as ``make_controller`` does."""
    return make_controller(
        settings.controller,
        settings.imputer,
        settings.blind,
        diffusion_of(settings),
        settings.q_weights,
        settings.signals.max_red,
        settings.net,
        min_space_of(settings),
    )


def min_space_of(settings: RunSettings) -> int:
    """The space [vehicles a lane] that ``Spillback`` keeps free in a run; 0 for none."""
    space = settings.signals.min_space
    if space is None:
        return MIN_SPACE if by_value(settings.controller, settings.diffusion) else 0
    return space


def resolved(settings: RunSettings) -> dict[str, object]:
    """What the settings that go by the controller are in a run: those that are "auto" or None.

    They say nothing of controllers that decide on no values.
    """
    name, diffusion = settings.controller, diffusion_of(settings)
    rule = settings.blind
    guided = name == DIFFLIGHT_PAPER or (name == DIFFLIGHT and is_guided(diffusion.scoring))
    return {
        "blind": _blind_rule(name, settings.imputer, diffusion) if rule == "auto" else rule,
        "min_space": min_space_of(settings),
        "sampling_steps": list(diffusion.reverse_steps(guided)),  # seen and blind intersections
        "weights": list(weights_of(settings)),
    }


def bounded(controller: Controller, max_red: int) -> Controller:
    """The controller with a maximum red [s], or as it is where that is 0."""
    return MaxRed(controller, max_red) if max_red else controller


def roomy(controller: Controller, min_space: int) -> Controller:
    """The controller with space kept free [vehicles a lane], or as it is where that is 0."""
    return Spillback(controller, min_space) if min_space else controller


def make_policy(name: str) -> Controller:
    """The controller ``name`` for complete observations; the learned ones have packaged weights."""
    if name in LEARNED or name == VALUE:
        return _learned(name, "auto", "")
    return CONTROLLERS[name].make()


def _blind_rule(name: str, imputer: str, diffusion: DiffusionSettings) -> str:
    """What "auto" is."""
    if by_value(name, diffusion):
        return "clustered"
    generates = name == DIFFLIGHT_PAPER or (imputer == DIFFUSION and name != DIFFLIGHT)
    return "none" if generates else "fixed-time"


def _difflight(settings: DiffusionSettings, q_weights: str) -> Controller:
    values = LOOKAHEAD if q_weights == "auto" else q_weights
    steps, blind_steps = settings.reverse_steps(is_guided(settings.scoring))
    return DiffLight(
        find_weights(settings.weights),
        steps,
        settings.scoring,
        find_weights(values) if by_value(DIFFLIGHT, settings) else None,
        settings.samples,
        blind_steps,
    )


def _published(settings: DiffusionSettings) -> Controller:
    """The method as its paper has it: the inverse dynamics decides, everywhere."""
    path = find_weights(settings.weights)
    controller = DiffLight(path, settings.reverse_steps(guided=True)[0], "inverse")
    if not controller.is_published:
        raise UserError(
            "weights",
            path,
            "weights of the method as published; `python -m tools.strict NET PATTERN "
            "--method paper` makes some",
        )
    return controller


def _learned(name: str, q_weights: str, net: str) -> Controller:
    """A Q-network or a baseline as a controller of its own; imports torch."""
    weights = policy_weights(name, q_weights, net)
    if name not in BASELINES:
        from tsc_missing.qlearning.controller import make_q_policy

        return make_q_policy(name, find_weights(weights))
    from tsc_missing.baselines.controller import make_baseline

    if q_weights == "auto" and weights not in packaged_weights():
        raise UserError(
            FIELD,
            weights,
            f"`{train_command(name, network_name(net))}` makes them, and "
            f"--policy-weights runs/train-{weights} uses them",
            verdict="are not in the package",
        )
    return make_baseline(name, find_weights(weights))
