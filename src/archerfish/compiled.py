"""JAX with our settings, imported where it is needed and not before."""

import hashlib
import importlib.util
import os
import platform
import sys
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Any

from archerfish import arrays
from archerfish.errors import InputError

forked: list[bool] = []
"""Not empty in a process that was forked while JAX was loaded: its threads are missing there, so that it would hang."""

if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=lambda: forked.append(True) if sys.modules.get("jax") else None)


def has_jax() -> bool:
    """Whether JAX is installed, and works in this process."""
    return not forked and importlib.util.find_spec("jax") is not None


def import_jax() -> Any:
    """Import JAX and have it keep compiled programs for the next process, unless it has a folder for them already.

    Raises:
      InputError: if it isn't installed.
    """
    if not has_jax():
        raise InputError("this needs JAX, which is not installed; pip install 'archerfish[train]'")
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # else XLA prints a page about each kept program (issue 44565)
    jax: Any = importlib.import_module("jax")
    arrays.register()
    if not jax.config.jax_compilation_cache_dir and (folder := _programs_folder()) is not None:
        with suppress(OSError):  # a home that can't be written: it works without
            folder.mkdir(parents=True, exist_ok=True)
            jax.config.update("jax_compilation_cache_dir", str(folder))
            jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
            jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
            jax.config.update("jax_compilation_cache_max_size", 2_000_000_000)  # only then are writes locked
            # A process that is killed while it writes leaves an entry that is compiled again.
            warnings.filterwarnings("ignore", message="Error (reading|writing) persistent compilation cache entry")
    return jax


def _programs_folder() -> Path | None:
    """Return the folder for programs compiled for this kind of machine."""
    import importlib.metadata  # slow to load

    # A home may be shared between machines, and a program for one processor may crash on another.
    facts = platform.machine() + platform.processor()
    with suppress(OSError):
        lines = set(Path("/proc/cpuinfo").read_text(errors="replace").splitlines())
        facts += "".join(sorted(each for each in lines if each.startswith(("model name", "flags", "Features"))))
    kind = f"{importlib.metadata.version('jaxlib')}-{hashlib.sha256(facts.encode()).hexdigest()[:12]}"
    folder = cache_folder("jax")
    return folder and folder / kind


def cache_folder(name: str) -> Path | None:
    """Return a folder for what can be made again.

    The environment variable ARCHERFISH_CACHE names another place than the user's cache; "off" keeps nothing: None.
    """
    place = os.environ.get("ARCHERFISH_CACHE", "")
    if place == "off":
        return None
    import platformdirs

    return Path(place or platformdirs.user_cache_path("archerfish")) / name
