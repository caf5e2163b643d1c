"""Which weights of the diffusion model a run uses.

Strict weights are of one network and pattern each, so that ``{net}``, ``{pattern}`` and ``{seed}``
in a name or path stand for those of the run.
"""

from tsc_missing.config import DiffusionSettings, RunSettings
from tsc_missing.network.folder import network_name
from tsc_missing.weights.find import DEFAULT

DIFFLIGHT_PAPER = "difflight-paper"  # the controller
PAPER_WEIGHTS = "paper-{net}-{pattern}"


def diffusion_of(settings: RunSettings) -> DiffusionSettings:
    """The diffusion settings of a run with the name of its weights filled in.

    For ``difflight-paper`` the default is ``PAPER_WEIGHTS``: the universal ones are of another
    model.
    """
    name = settings.diffusion.weights
    if settings.controller == DIFFLIGHT_PAPER and name == DEFAULT:
        name = PAPER_WEIGHTS
    return settings.diffusion.model_copy(update={"weights": fill_in(name, settings)})


def fill_in(text: str, settings: RunSettings) -> str:
    """The text with a run's network, pattern and seed in the place of their names in braces.

    The patterns that weights are made for are kriging, and random for all others.
    """
    values = {
        "net": network_name(settings.net),
        "pattern": "kriging" if settings.missing.pattern == "kriging" else "random",
        "seed": str(settings.seed),
    }
    for name, value in values.items():
        text = text.replace(f"{{{name}}}", value)
    return text
