"""Whether a run's blind intersections are those that its strict weights never learned from."""

from tsc_missing.config import MissingSettings
from tsc_missing.controllers.diffusion_weights import diffusion_of
from tsc_missing.controllers.resolved import weights_of
from tsc_missing.diffusion.weights import KIND
from tsc_missing.evaluation.run import Prepared
from tsc_missing.network.folder import canonical
from tsc_missing.sensing.patterns import draw_mask
from tsc_missing.weights.file import read_tensors
from tsc_missing.weights.find import find_weights


def observed_in_the_log(prepared: Prepared) -> tuple[tuple[str, ...], int] | None:
    """The run's blind intersections that the kriging log of its weights did observe.

    Their ids, and the log's mask seed, at which there are none at rates up to the log's. None
    where all are as they should be, or the weights are not from a kriging log of this network.
    """
    settings, network = prepared.settings, prepared.scene.network
    name = diffusion_of(settings).weights
    if name not in weights_of(settings):
        return None
    manifest, _ = read_tensors(find_weights(name), KIND)
    collected = manifest.get("data", {}).get("settings", {})
    missing = MissingSettings.model_validate(collected.get("missing", {}))
    nets = [canonical(net) for net in collected.get("nets", ())]
    if missing.pattern != "kriging" or canonical(settings.net) not in nets:
        return None

    logged = draw_mask(missing, network, 1, collected["seed"])[0]
    there = network.slot_mask
    observed = (logged & there).any(axis=1) & ~(prepared.scene.mask & there).any(axis=(0, 2))
    ids = tuple(name for name, one in zip(network.ids, observed, strict=True) if one)
    return (ids, collected["seed"]) if ids else None
