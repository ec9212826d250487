"""Where a result comes from: the seed, the code and the inputs that made it."""

import functools
import importlib.metadata
import platform
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from archerfish import __version__
from archerfish.records.storage import file_hash


@functools.cache
def code_commit() -> str:
    """Return the commit of the running code with "-dirty" if it was changed, or "unknown" outside a checkout."""
    try:
        described = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            timeout=10,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return described.stdout.strip() or "unknown"


def library_versions() -> dict[str, str]:
    """Return the versions of Python, Archerfish and the libraries whose numbers a result depends on."""
    versions = {"python": platform.python_version(), "archerfish": __version__}
    for name in ("numpy", "scipy", "jax", "optax"):
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return versions


def provenance(seed: int | None = None, inputs: Iterable[Path] = ()) -> dict[str, Any]:
    """Describe the making of a record.

    Args:
      seed: the seed that the result depends on, if any.
      inputs: the files that it was made from.

    Returns:
      `seed`, `commit`, `versions`, and `inputs` as file name → SHA-256.
    """
    return {
        "seed": seed,
        "commit": code_commit(),
        "versions": library_versions(),
        "inputs": {path.name: file_hash(path) for path in inputs},
    }
