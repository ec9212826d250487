"""Controllers, target motions and plants of a user's own: from a file, from a module, or from an installed package.

A name of either says where to look: `./file.py:Name`, `module:Name` (a file of that name in the working folder comes
first), or the name of an entry point. Nothing of Archerfish is edited, and nothing is registered.
"""

import difflib
import hashlib
import importlib
import importlib.metadata
import sys
import traceback
import types
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from archerfish.records.errors import InputError

GROUPS = {"controller": "archerfish.controllers", "motion": "archerfish.motions", "plant": "archerfish.plants"}
"""Kind → group of entry points."""
FORMS = "./FILE.py:NAME, MODULE:NAME or the name of an installed entry point"
_LONGEST = 240
_COMPILED = ("Tracer", "Concretization", "NonConcrete", "UnexpectedTracer")
"""How the names of JAX's errors begin for code that can't be compiled."""


class Extension(NamedTuple):
    """Something of a user's own."""

    name: str
    """By which results call it."""
    value: Any
    """What the name stands for in the user's code."""
    where: str
    """For messages: file or module, and name."""
    file: Path | None
    """Its source; None where it has none."""


def is_extension(spec: str, kind: str) -> bool:
    """Tell whether a word names something of the user's own, and not a file of data or something built in.

    Args:
      spec: the word.
      kind: one of `GROUPS`.
    """
    return ":" in spec.replace("\\", "/").rpartition("/")[2] or spec in extension_names(kind)


def extension_names(kind: str) -> tuple[str, ...]:
    """Return the names of the entry points that installed packages bring.

    Args:
      kind: one of `GROUPS`.
    """
    return tuple(sorted({each.name for each in importlib.metadata.entry_points(group=GROUPS[kind])}))


def find_extension(spec: str, kind: str) -> Extension:
    """Find something of a user's own.

    Args:
      spec: ./FILE.py:NAME, MODULE:NAME, or the name of an entry point.
      kind: one of `GROUPS`.

    Raises:
      InputError: if there is no such file, module, name or entry point, or its code fails.
    """
    where, _, name = spec.rpartition(":")
    if not where and spec.endswith(".py"):
        raise InputError(f"{spec}: says no name, expected the {kind}'s after a colon; write {spec}:NAME")
    if not where:
        return _entry_point(spec, kind)
    if not name:
        raise InputError(f"{kind} {spec!r} says no name, expected {FORMS}; write {spec}NAME")
    return _named(where, name, name, kind)


def _entry_point(name: str, kind: str) -> Extension:
    found = {each.value: each for each in importlib.metadata.entry_points(group=GROUPS[kind], name=name)}
    if not found:
        known = ", ".join(extension_names(kind)) or "none"
        raise InputError(f"there is no {kind} {name!r}, expected {FORMS} (installed: {known})")
    if len(found) > 1:
        raise InputError(
            f"{kind} {name!r} is brought by several packages, as {' and '.join(sorted(found))}; write one of these"
        )
    entry = found.popitem()[1]
    # Of the installed package alone: a file of that name in the working folder is another.
    return _attribute(_installed(entry.module, entry.value, kind), entry.module, entry.attr, name)


def _named(where: str, attribute: str, name: str, kind: str) -> Extension:
    return _attribute(_module(where, f"{where}:{attribute}", kind), where, attribute, name)


def _attribute(module: types.ModuleType, where: str, attribute: str, name: str) -> Extension:
    value: Any = module
    for part in attribute.split("."):
        if not hasattr(value, part):
            raise InputError(f"{where}: has no {attribute!r}; {_meant(module, part)}")
        value = getattr(value, part)
    source = getattr(module, "__file__", None)
    return Extension(name, value, f"{where}:{attribute}", Path(source) if source else None)


def _meant(module: types.ModuleType, name: str) -> str:
    own = [each for each, value in vars(module).items() if getattr(value, "__module__", None) == module.__name__]
    close = difflib.get_close_matches(name, own, 1)
    if close:
        return f"perhaps you meant {close[0]}"
    return f"it defines {', '.join(own) or 'nothing'}"


def _module(where: str, told: str, kind: str) -> types.ModuleType:
    is_path = where.endswith(".py") or "/" in where or "\\" in where
    path = Path(where if is_path else where.replace(".", "/") + ".py")
    if not is_path and not path.is_file():
        return _imported(where, told, kind)
    if not path.is_file():
        raise InputError(f"{kind} {told!r}: there is no file {where}, expected {FORMS}")
    path = path.resolve()
    # Not by its stem, which another file may have; the same for the same file, so that its classes stay the same.
    name = f"archerfish_extension_{path.stem}_{hashlib.sha256(bytes(path)).hexdigest()[:8]}"
    if name not in sys.modules:
        module = types.ModuleType(name)
        module.__file__ = str(path)
        sys.modules[name] = module
        try:
            # Not by the import system, which would leave compiled files beside the user's.
            with _on_path(path.parent), own_code(Extension(name, None, where, path)):
                exec(compile(path.read_bytes(), str(path), "exec", dont_inherit=True), module.__dict__)
        except BaseException:
            del sys.modules[name]
            raise
    return sys.modules[name]


def _imported(where: str, told: str, kind: str) -> types.ModuleType:
    with _on_path(Path.cwd()):
        return _installed(where, told, kind)


def _installed(where: str, told: str, kind: str) -> types.ModuleType:
    try:
        return importlib.import_module(where)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{where}.".startswith(f"{error.name}."):
            raise InputError(f"{told}: {_told(error, None)}") from error
        beside = f"neither installed nor a file {where.replace('.', '/')}.py in {Path.cwd()}"
        raise InputError(f"{kind} {told!r}: there is no module {error.name}: {beside}; expected {FORMS}") from error
    except (Exception, SystemExit) as error:
        raise InputError(f"{told}: {_told(error, None)}") from error


@contextmanager
def _on_path(folder: Path) -> Iterator[None]:
    """Let a file import what lies beside it; what is installed comes first."""
    mine = str(folder)
    sys.path.append(mine)
    try:
        yield
    finally:
        # The last one: an equal one before it was there already.
        for index in reversed(range(len(sys.path))):
            if sys.path[index] == mine:
                del sys.path[index]
                break


@contextmanager
def own_code(extension: Extension) -> Iterator[None]:
    """Turn whatever a user's code raises into one line that names its file and the line in it.

    Raises:
      InputError: in the place of any other exception, and before any other `InputError` the name of the code.
    """
    try:
        yield
    except InputError as error:
        told = str(error)
        raise (error if told.startswith(extension.where) else InputError(f"{extension.where}: {told}")) from error
    except (Exception, SystemExit) as error:
        raise InputError(f"{extension.where}: {_told(error, extension.file)}") from error


def _told(error: BaseException, file: Path | None) -> str:
    """Say what was raised, where in the user's file, and, of code that can't be compiled, what to do."""
    first = (str(error).strip().splitlines() or [""])[0]
    said = f"{type(error).__name__}: {first}" if first else type(error).__name__
    said = said if len(said) <= _LONGEST else said[: _LONGEST - 1] + "…"
    if isinstance(error, SyntaxError):
        return f"line {error.lineno}: {said}; mend it"
    lines = [number for frame, number in traceback.walk_tb(error.__traceback__) if _of(frame, file)]
    at = f"line {lines[-1]}: " if lines else ""
    if type(error).__name__.startswith(_COMPILED):
        remedy = "it runs compiled, for many engagements at once: write xp = namespace(x) and xp.where for if"
        return f"{at}{said.partition(':')[0]}; {remedy}"
    return f"{at}{said}; mend it"


def _of(frame: types.FrameType, file: Path | None) -> bool:
    return file is not None and frame.f_code.co_filename == str(file)
