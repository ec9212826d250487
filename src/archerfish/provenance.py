"""Where a result comes from: the seed, the code and the inputs that made it."""

import functools
import importlib.metadata
import os
import platform
import subprocess
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from archerfish import __version__
from archerfish.storage import file_hash

_HERE = Path(__file__).resolve().parent


@functools.cache
def code_commit() -> str:
    """Return the commit of the running code, with "-dirty" if it was changed; "unknown" outside its own checkout."""
    env = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}  # as inside a hook
    git = functools.partial(subprocess.check_output, cwd=_HERE, env=env, stderr=subprocess.PIPE, text=True, timeout=10)
    try:
        top = Path(git(["git", "rev-parse", "--show-toplevel"]).strip())
        # An installed package may lie inside the repository of another project, whose commit says nothing of it.
        is_own = top / "src" / _HERE.name == _HERE and 'name = "archerfish"' in (top / "pyproject.toml").read_text(
            "utf-8"
        )
        described = git(["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]).strip()
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return described if is_own else "unknown"


def library_versions() -> dict[str, str]:
    """Return the versions of Python, Archerfish and the libraries whose numbers a result depends on."""
    versions = {"python": platform.python_version(), "archerfish": __version__}
    for name in ("numpy", "scipy", "jax", "mujoco"):
        with suppress(importlib.metadata.PackageNotFoundError):
            versions[name] = importlib.metadata.version(name)
    return versions


def code_changes(commit: str, versions: dict[str, str]) -> list[str]:
    """Return what differs between the running code with its libraries and those of an earlier time, a text for each."""
    before, now = {"commit": commit, **versions}, {"commit": code_commit(), **library_versions()}
    return [f"{name} {before.get(name)} → {value}" for name, value in now.items() if before.get(name) != value]


def provenance(seed: int | None = None, inputs: Iterable[Path] = ()) -> dict[str, Any]:
    """Describe how a record was made.

    Args:
      seed: the seed that the result depends on, if any.
      inputs: the files that it was made from.

    Returns:
      `seed`, `commit`, `versions`, and `inputs` as path, from the innermost folder that has all of them, → SHA-256.
    """
    paths = [path.resolve() for path in inputs]
    common = os.path.commonpath([path.parent for path in paths]) if paths else ""
    hashes = {path.relative_to(common).as_posix(): file_hash(path) for path in paths}
    return {"seed": seed, "commit": code_commit(), "versions": library_versions(), "inputs": hashes}
