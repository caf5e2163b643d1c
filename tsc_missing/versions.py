"""The versions that a result depends on."""

import functools
import hashlib
import importlib.metadata
import platform
import shutil
import subprocess

from tsc_missing.paths import PACKAGE

DISTRIBUTIONS = ("tsc-missing", "libsumo", "numpy", "scipy", "torch")
SOURCE = "source"
NO_PART_OF_A_RESULT = ("cli", "report")  # packages that only ask for runs and show them


@functools.cache
def versions() -> dict[str, str]:
    """Python's and the installed distributions' versions, and what stands for the source code."""
    found = {"python": platform.python_version(), SOURCE: source_digest()}
    for name in DISTRIBUTIONS:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def source_digest() -> str:
    """12 hexadecimal digits that change with any module that a result may depend on."""
    digest = hashlib.sha256()
    for path in sorted(PACKAGE.rglob("*.py")):
        place = path.relative_to(PACKAGE)
        if place.parts[0] not in NO_PART_OF_A_RESULT:
            digest.update(f"{place.as_posix()}\0".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


@functools.cache
def git_revision() -> str | None:
    """The checkout's commit, ``-dirty`` where files differ from it; None outside a checkout."""
    root = PACKAGE.parent
    if not (root / ".git").exists() or shutil.which("git") is None:
        return None
    command = ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=12"]
    result = subprocess.run(command, capture_output=True, text=True)
    return result.stdout.strip() or None
