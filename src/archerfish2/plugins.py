"""Code of a user's own: found once by its name, and passed on as an object.

A name says where it is: `./file.py:Name`, `module:Name` (a file of that name in the working folder comes first), or an
entry point of the group `archerfish.controllers`, `archerfish.motions`, `archerfish.plants` or `archerfish.worlds`.
Names come from the command line or from Python: code that a data file names is never run.
"""

import hashlib
import importlib
import operator
import sys
import types
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from archerfish2.errors import InputError, one_line

FORMS = "./FILE.py:NAME, MODULE:NAME or the name of an installed entry point"
_TRACED = ("Tracer", "Concretization", "NonConcrete", "UnexpectedTracer")  # JAX's errors of code that can't be compiled


@dataclass(frozen=True, eq=False)
class Plugin:
    """Something of a user's own; another process finds it again by its name."""

    spec: str
    """Its name, with the full path of a file."""
    kind: str
    """What it is: "controller", "motion", "plant", "world" …"""
    name: str
    """By which results call it."""
    value: Any
    """What the name stands for in the user's code."""
    file: str
    """Its source; "" where it has none."""

    def __reduce__(self) -> tuple[Any, ...]:
        return find_plugin, (self.spec, self.kind)

    @contextmanager
    def running(self) -> Iterator[None]:
        """Turn whatever the user's code raises in a block into one line that names its file and the line in it.

        Raises:
          InputError: in the place of any other exception, and before another `InputError` the name of the code.
        """
        try:
            yield
        except InputError as error:
            text = str(error)
            raise (error if text.startswith(self.spec) else InputError(f"{self.spec}: {text}")) from error
        except (Exception, SystemExit) as error:
            import traceback  # slow to load

            lines = [each.lineno for each in traceback.extract_tb(error.__traceback__) if each.filename == self.file]
            if isinstance(error, SyntaxError) and error.filename == self.file:
                lines.append(error.lineno)
            line = lines[-1] if lines else None
            place, name = f"line {line}: " if line else "", type(error).__name__
            text = one_line(f"{name}: {(str(error).strip().splitlines() or [''])[0]}")[:240]
            compiled = "it runs compiled, for many engagements at once: write xp = namespace(x) and xp.where for if"
            remedy = compiled if name.startswith(_TRACED) else "correct it"
            raise InputError(f"{self.spec}: {place}{text}; {remedy}") from error


def names_code(spec: str) -> bool:
    """Whether a name is one of code in a file or module, which a data file may not name."""
    return ":" in spec


def is_plugin(spec: str, kind: str) -> bool:
    """Whether a name is one of a user's own code, and neither a file of data nor something built in."""
    return names_code(spec) or spec in _entry_points(kind).names


def find_plugin(spec: Any, kind: str) -> Plugin:
    """Find something of a user's own.

    Args:
      spec: ./FILE.py:NAME, MODULE:NAME, or the name of an entry point; or the object itself.
      kind: what is looked for: "controller", "motion", "plant", "world" …

    Raises:
      InputError: if there is no such file, module, name or entry point, or its code fails.
    """
    if not isinstance(spec, str):
        file = getattr(sys.modules.get(getattr(spec, "__module__", "")), "__file__", None) or ""
        name = getattr(spec, "__name__", type(spec).__name__)
        return Plugin(f"{file}:{name}", kind, name, spec, file)
    where, _, name = spec.rpartition(":")
    try:
        path = Path(where if where.endswith(".py") else where.replace(".", "/") + ".py").resolve()
        is_file, attribute = bool(where) and path.is_file(), name
    except (OSError, ValueError) as error:
        raise InputError(f"{kind} {one_line(spec)[:100]!r} can't be a name of a file; expected {FORMS}") from error
    if is_file:
        spec = f"{path}:{name}"
    elif where.endswith(".py"):
        raise InputError(f"{kind} {spec!r}: there is no file {where}; expected {FORMS}")
    elif not where:
        found = {each.value for each in _entry_points(kind).select(name=spec)}
        if len(found) != 1:
            state = f"is in several packages, as {' and '.join(sorted(found))}" if found else "is not installed"
            raise InputError(f"{kind} {spec!r} {state}; expected {FORMS}")
        where, _, attribute = found.pop().partition(":")
    plugin = Plugin(spec, kind, name, None, str(path) if is_file else "")
    with plugin.running():
        module = _module(path) if is_file else importlib.import_module(where)
        if not hasattr(module, attribute.partition(".")[0]):
            own = (each for each, value in vars(module).items() if getattr(value, "__module__", "") == module.__name__)
            raise InputError(f"has no {attribute!r}, but {', '.join(own) or 'nothing'}; name one of these")
        return replace(plugin, value=operator.attrgetter(attribute)(module))


def _module(path: Path) -> types.ModuleType:
    """Run a file, once per process; not by the import system, which would leave compiled files beside the user's."""
    # Not by its stem, which another file may have, and under the package's name, which another edition has not.
    name = f"{__package__}_plugin_{path.stem}_{hashlib.sha256(bytes(path)).hexdigest()[:8]}"
    if name not in sys.modules:
        module = sys.modules[name] = types.ModuleType(name)
        module.__file__ = str(path)
        beside = [str(path.parent)] if str(path.parent) not in sys.path else []
        sys.path += beside  # what is installed comes first
        try:
            exec(compile(path.read_bytes(), str(path), "exec", dont_inherit=True), module.__dict__)
        except BaseException:
            del sys.modules[name]
            raise
        finally:
            for each in beside:
                sys.path.remove(each)
    return sys.modules[name]


def _entry_points(kind: str) -> Any:
    # Imported here, as it is slow to load.
    return importlib.import_module("importlib.metadata").entry_points(group=f"archerfish.{kind}s")
