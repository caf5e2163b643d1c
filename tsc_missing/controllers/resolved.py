"""What the settings of a run come to: what goes by its controller, and what it reads."""

from tsc_missing.baselines.config import SETTINGS as BASELINES
from tsc_missing.config import MIN_SPACE, MIN_SPACE_AHEAD, DiffusionSettings, RunSettings
from tsc_missing.controllers.catalogue import (
    DIFFLIGHT,
    by_model,
    by_value,
    is_learned,
    needs_values,
)
from tsc_missing.controllers.difflight import is_guided
from tsc_missing.controllers.diffusion_weights import DIFFLIGHT_PAPER, diffusion_of
from tsc_missing.imputation.registry import DIFFUSION
from tsc_missing.network.folder import network_name
from tsc_missing.own_code import is_own
from tsc_missing.simulation.native import RECALL

LOOKAHEAD = ("lookahead", "lookahead-second", "lookahead-first")  # for the scoring "value"


def weights_of(settings: RunSettings) -> tuple[str, ...]:
    """The names or paths of the weights that a run's controller and imputer use; often none."""
    name, q_weights = settings.controller, settings.q_weights
    diffusion = diffusion_of(settings).weights
    if name == DIFFLIGHT_PAPER:
        return (diffusion,)
    if name == DIFFLIGHT:
        values = value_weights(q_weights) if by_value(name, settings.diffusion) else ()
        return (diffusion, *values)
    found = (policy_weights(name, q_weights, settings.net),) if is_learned(name) else ()
    imputer = (diffusion,) if settings.imputer == DIFFUSION and needs_values(name) else ()
    return (*found, *imputer)


def uses_weights(settings: RunSettings) -> bool:
    """Whether the run's controller, or the imputer that it is composed with, is a trained model."""
    return bool(weights_of(settings))


def code_of(settings: RunSettings) -> tuple[tuple[str, str], ...]:
    """The setting and the name of each class of a user's own that a run uses; often none."""
    name, imputer = settings.controller, settings.imputer
    controllers = (("controller", name),) if is_own(name) else ()
    imputers = (("imputer", imputer),) if is_own(imputer) and needs_values(name) else ()
    return (*controllers, *imputers)


def value_weights(q_weights: str) -> tuple[str, ...]:
    """The names or paths of the weights of the scoring "value": one or, by commas, more."""
    if q_weights == "auto":
        return LOOKAHEAD
    return tuple(name.strip() for name in q_weights.split(","))


def policy_weights(controller: str, q_weights: str, net: str) -> str:
    """The name or path of the weights of a learned policy on a network.

    Packaged weights of Q-networks are for any network and called as the controller; those of
    baselines are for one network each and called ``<controller>-<network>``. In a name or path of
    one's own ``{net}`` stands for the network.
    """
    if q_weights != "auto":
        return q_weights.replace("{net}", network_name(net))
    return f"{controller}-{network_name(net)}" if controller in BASELINES else controller


def blind_rule(name: str, imputer: str, diffusion: DiffusionSettings) -> str:
    """What the rule "auto" for blind intersections is.

    The fixed cycle; but for who plans on a traffic model only where no other signal is near, and
    none for ``difflight-paper``, for own controllers that fill holes themselves and for
    ``actuated-recall``, whose greens last to their maximum there; with the diffusion imputer it
    runs only at intersections of a kind that its packaged weights never saw (``learned_kind``), and
    for ``difflight`` by values there and where two adjacent intersections are blind, without a
    sensor or for long.
    """
    if by_value(name, diffusion):
        return "clustered"
    if by_model(name, diffusion):
        return "alone"
    if name in (DIFFLIGHT_PAPER, RECALL) or (is_own(name) and not needs_values(name)):
        return "none"
    return "familiar" if imputer == DIFFUSION and name != DIFFLIGHT else "fixed-time"


def min_space_of(settings: RunSettings) -> int:
    """The space [vehicles a lane] that ``Spillback`` keeps free in a run; 0 for none."""
    space = settings.signals.min_space
    if space is None:
        if by_model(settings.controller, settings.diffusion):
            return MIN_SPACE_AHEAD
        return MIN_SPACE if by_value(settings.controller, settings.diffusion) else 0
    return space


def resolved(settings: RunSettings) -> dict[str, object]:
    """What the settings that go by the controller are in a run: those that are "auto" or None.

    They say nothing of controllers that look at no sensor, and ``sampling_steps`` nothing where no
    diffusion model runs.
    """
    name, diffusion = settings.controller, diffusion_of(settings)
    rule = settings.blind
    guided = name == DIFFLIGHT_PAPER or (name == DIFFLIGHT and is_guided(diffusion.scoring))
    return {
        "blind": blind_rule(name, settings.imputer, diffusion) if rule == "auto" else rule,
        "min_space": min_space_of(settings),
        "sampling_steps": list(diffusion.reverse_steps(guided)),  # seen and blind intersections
        "weights": list(weights_of(settings)),
    }
