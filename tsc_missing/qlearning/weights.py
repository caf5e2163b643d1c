"""The weights files of Q-networks."""

from pathlib import Path
from typing import Any

from tsc_missing.errors import UserError
from tsc_missing.qlearning.features import NAMES
from tsc_missing.qlearning.networks import QNetwork, make_q_network
from tsc_missing.training.diverged import check_weights
from tsc_missing.weights.file import read_tensors, write_tensors
from tsc_missing.weights.find import FIELD

KIND = "q-network"


def save_q_network(
    network: QNetwork, algorithm: str, width: int, path: Path, about: dict[str, Any]
) -> None:
    """Write a network's weights and a manifest: what it is, and ``about`` (JSON values).

    Raises ``DivergedError`` for weights that are not finite.
    """
    check_weights(network.state_dict().values())
    manifest = {
        **about,
        "algorithm": algorithm,
        "width": width,
        "history": network.history,
        "certainty": network.certainty,
        "features": list(NAMES),
    }
    write_tensors(path, KIND, network.state_dict(), manifest)


def load_q_network(path: Path) -> tuple[QNetwork, dict[str, Any]]:
    """The network of a weights file, in evaluation mode, and its manifest.

    Raises ``UserError`` for a file that is not there, cut off, of another version or changed.
    """
    manifest, tensors = read_tensors(path, KIND)
    if manifest.get("features") != list(NAMES):
        raise UserError(FIELD, path, "it was trained on other features than this program has")
    try:
        sees = manifest.get("history", 0), manifest.get("certainty", False)
        network = make_q_network(manifest["algorithm"], manifest["width"], *sees)
        network.load_state_dict(tensors)
    except (KeyError, TypeError, RuntimeError):
        raise UserError(FIELD, path, "its tensors are not those of its algorithm") from None
    return network.requires_grad_(False).eval(), manifest
