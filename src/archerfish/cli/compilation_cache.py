"""Compiled programs that are kept for the next run: a training begins in a fraction of the time.

A kept program is the one that compiling would give again, so results are the same to the bit.
"""

import functools
import hashlib
import importlib
import os
import platform
import sys
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

VARIABLE = "ARCHERFISH_CACHE"
"""Names the folder for what may be thrown away; "off" keeps nothing."""
OFF = "off"
SHORTEST_S = "0.2"
"""Programs that are compiled quicker are not kept [s]."""
_CHECKED = ".checked"


def keep_compiled() -> Path | None:
    """Have JAX keep compiled programs, in this process and those that it starts.

    Returns:
      The folder; none where it is switched off, can't be written, or JAX was told of another one already.
    """
    if os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        importlib.import_module("jax")
        load_quietly()
        return None
    folder = cache_folder()
    if folder is None:
        return None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _remove_truncated(folder)
    except OSError:  # a home that can't be written: training works without
        return None
    settings = {
        "jax_compilation_cache_dir": str(folder),
        "jax_persistent_cache_min_compile_time_secs": SHORTEST_S,
        "jax_persistent_cache_min_entry_size_bytes": "-1",
    }
    os.environ.update({name.upper(): value for name, value in settings.items()})
    warnings.filterwarnings("ignore", message=".*persistent compilation cache.*")
    configure: Any = importlib.import_module("jax").config
    configure.update("jax_compilation_cache_dir", str(folder))
    configure.update("jax_persistent_cache_min_compile_time_secs", float(SHORTEST_S))
    configure.update("jax_persistent_cache_min_entry_size_bytes", -1)
    load_quietly()
    return folder


def load_quietly() -> None:
    """Let JAX, if it is there, load kept programs without what XLA says of each.

    On some processors XLA takes tuning flags of its own for abilities that the machine lacks, and prints a page of
    warnings for every program that this very machine compiled (openxla/xla issue 44565). No setting silences it.
    """
    if "jax" not in sys.modules or not os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        return
    try:
        cache: Any = importlib.import_module("jax._src.compilation_cache")
        load = cache.get_executable_and_time
    except (ImportError, AttributeError):  # another version of JAX: the warnings are seen
        return
    if not hasattr(load, "quiet"):
        cache.get_executable_and_time = _without_stderr(load)


def _without_stderr(function: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, 2)
            return function(*arguments, **named)
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            os.close(nowhere)

    call.quiet = True  # type: ignore[attr-defined]
    return call


def cache_folder() -> Path | None:
    """Return the folder for compiled programs of this kind of machine, none if they are not to be kept."""
    asked = os.environ.get(VARIABLE, "")
    if asked == OFF:
        return None
    users = os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()
    # A program for one processor may crash on another one: a home may be shared between machines.
    return Path(asked or Path(users) / "archerfish") / "jax" / _processor()


def _processor() -> str:
    described = platform.machine() + platform.processor()
    facts = Path("/proc/cpuinfo")
    if facts.is_file():
        lines = facts.read_text(errors="replace").splitlines()
        described += "".join(sorted({each for each in lines if each.startswith(("model name", "flags", "Features"))}))
    return hashlib.sha256(described.encode()).hexdigest()[:12]


def _remove_truncated(folder: Path) -> None:
    """Remove what a killed process wrote by half, which JAX would stumble over every time, and never replace."""
    stamp = folder / _CHECKED
    since = stamp.stat().st_mtime if stamp.exists() else 0.0
    newer = [each for each in folder.glob("*-cache") if each.stat().st_mtime >= since - 1.0]
    stamp.touch()
    for path in newer:
        if not _is_whole(path.read_bytes()):
            path.unlink(missing_ok=True)


def _zstd_decompress(content: bytes) -> None:
    try:
        importlib.import_module("compression.zstd").decompress(content)
    except ImportError:  # before Python 3.14
        importlib.import_module("zstandard").ZstdDecompressor().decompress(content)


def _is_whole(content: bytes) -> bool:
    try:
        if content[:4] == b"\x28\xb5\x2f\xfd":
            _zstd_decompress(content)
        else:
            zlib.decompress(content)
    except ImportError:
        return True
    except Exception:
        return False
    return True
