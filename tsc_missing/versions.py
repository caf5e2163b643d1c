"""The versions that a result depends on."""

import functools
import importlib.metadata
import platform
import shutil
import subprocess

from tsc_missing.paths import PACKAGE

DISTRIBUTIONS = ("tsc-missing", "libsumo", "numpy", "torch")


@functools.cache
def versions() -> dict[str, str]:
    """Python's and the installed distributions' versions."""
    found = {"python": platform.python_version()}
    for name in DISTRIBUTIONS:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


@functools.cache
def git_revision() -> str | None:
    """The checkout's commit, ``-dirty`` where files differ from it; None outside a checkout."""
    root = PACKAGE.parent
    if not (root / ".git").exists() or shutil.which("git") is None:
        return None
    command = ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=12"]
    result = subprocess.run(command, capture_output=True, text=True)
    return result.stdout.strip() or None
