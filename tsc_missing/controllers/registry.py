"""Controllers by name, composed with an imputer and a rule for blind intersections."""

from collections.abc import Callable

from tsc_missing.baselines.config import SETTINGS as BASELINES
from tsc_missing.baselines.config import train_command, trained_folder
from tsc_missing.config import DiffusionSettings, RunSettings
from tsc_missing.controllers.base import Controller
from tsc_missing.controllers.blind import Blind
from tsc_missing.controllers.catalogue import (
    CONTROLLERS,
    DIFFLIGHT,
    LEARNED,
    VALUE,
    by_value,
    is_learned,
    looks_at_nothing,
    needs_values,
    require_controller,
)
from tsc_missing.controllers.difflight import DiffLight, is_guided
from tsc_missing.controllers.diffusion_weights import DIFFLIGHT_PAPER, diffusion_of
from tsc_missing.controllers.expected_queue import ExpectedQueue
from tsc_missing.controllers.fixed_time import Cycle, FixedTime
from tsc_missing.controllers.max_red import bounded
from tsc_missing.controllers.own import OwnController
from tsc_missing.controllers.resolved import (
    blind_rule,
    min_space_of,
    policy_weights,
    value_weights,
)
from tsc_missing.controllers.spillback import Spillback
from tsc_missing.errors import UserError, nearest
from tsc_missing.imputation.base import Imputed
from tsc_missing.imputation.registry import make_imputer, require_imputer
from tsc_missing.network.folder import network_name
from tsc_missing.own_code import is_own
from tsc_missing.weights.find import MAKES_VALUES, find_weights, packaged_weights

POLICY_WEIGHTS = "q_weights"  # the setting of a learned policy's and of values' weights
LONG_SILENCE = 40  # [decision steps] 10 minutes: readings lost at random come back before

BLIND: dict[str, Callable[[Controller, int], Controller]] = {  # of a controller and a maximum red
    "none": lambda controller, _: controller,
    "expected-queue": lambda controller, red: Blind(controller, bounded(ExpectedQueue(), red)),
    "fixed-time": lambda controller, _: Blind(controller, FixedTime()),
    "familiar": lambda controller, _: Blind(controller, FixedTime(), LONG_SILENCE, familiar=True),
    "alone": lambda controller, _: Blind(controller, FixedTime(), LONG_SILENCE, alone=True),
    "clustered": lambda controller, _: Blind(
        controller, FixedTime(), LONG_SILENCE, clustered=True, familiar=True
    ),
}


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
    """The controller ``name``; with an imputer if it needs values.

    Unless it looks at no sensor it has the rule ``blind``; there ``Spillback`` keeps ``min_space``
    [vehicles a lane] free, and ``MaxRed`` bounds its reds by ``max_red`` [s], which has the last
    word, each if it is not 0. Those that look at no sensor are bounded too; fixed plans are left as
    they are.
    The rule "auto" goes by the controller (``blind_rule``). An own controller, ``FILE.py:NAME``,
    that fills holes itself is bounded too: it is no fixed plan.
    ``q_weights`` are those of a learned policy, a name or a path; "auto" are packaged ones, of
    baselines those for the network ``net``. Raises ``UserError`` for names that are unknown and
    for weights that cannot be used.
    """
    require_controller(name)
    diffusion = diffusion or DiffusionSettings()
    if blind == "auto":
        blind = blind_rule(name, imputer, diffusion)
    require_imputer(imputer)
    decides = _deciding(name, diffusion, q_weights, net)
    if needs_values(name):
        decides = Imputed(make_imputer(imputer, diffusion), decides)
    elif is_own(imputer):
        words = f"{name} does not decide on filled values, so it would do nothing"
        raise UserError("imputer", imputer, words)
    elif looks_at_nothing(name):
        return decides if isinstance(decides, Cycle) else bounded(decides, max_red)
    return ruled(decides, blind, min_space, max_red)


def ruled(decides: Controller, blind: str, min_space: int, max_red: int) -> Controller:
    """A controller with space kept free, its reds bounded, and a rule where nobody sees.

    Raises ``UserError`` for a ``blind`` that is unknown, as "auto" is here.
    """
    if blind not in BLIND:
        raise UserError("blind", blind, nearest(blind, BLIND))
    return BLIND[blind](bounded(roomy(decides, min_space), max_red), max_red)


def _deciding(name: str, diffusion: DiffusionSettings, q_weights: str, net: str) -> Controller:
    """The controller itself, on what it sees."""
    if is_own(name):
        return OwnController(name)
    if name == DIFFLIGHT:
        return _difflight(diffusion, q_weights)
    if name == DIFFLIGHT_PAPER:
        return _published(diffusion)
    return _learned(name, q_weights, net) if is_learned(name) else CONTROLLERS[name]()


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


def roomy(controller: Controller, min_space: int) -> Controller:
    """The controller with space kept free [vehicles a lane], or as it is where that is 0."""
    return Spillback(controller, min_space) if min_space else controller


def make_policy(name: str) -> Controller:
    """The controller ``name`` for complete observations; the learned ones have packaged weights."""
    if name in LEARNED or name == VALUE:
        return _learned(name, "auto", "")
    return CONTROLLERS[name]()


def _difflight(settings: DiffusionSettings, q_weights: str) -> Controller:
    values = value_weights(q_weights) if by_value(DIFFLIGHT, settings) else ()
    steps, blind_steps = settings.reverse_steps(is_guided(settings.scoring))
    return DiffLight(
        find_weights(settings.weights),
        steps,
        settings.scoring,
        [find_weights(name, MAKES_VALUES, POLICY_WEIGHTS) for name in values],
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

        return make_q_policy(name, find_weights(weights, f"tsc-train {name}", POLICY_WEIGHTS))
    from tsc_missing.baselines.controller import make_baseline

    command = train_command(name, network_name(net))
    folder = trained_folder(name, network_name(net))
    if q_weights == "auto" and weights not in packaged_weights():
        raise UserError(
            POLICY_WEIGHTS,
            weights,
            f"`{command}` makes them, and --policy-weights {folder} uses them",
            verdict="are not in the package",
        )
    return make_baseline(name, find_weights(weights, command, POLICY_WEIGHTS))
