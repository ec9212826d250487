"""Code of a user's own: found by its name, and passed on as an object.

A name says where it is: `./file.py:Name`, `module:Name` (an installed module, or else a file of that name in the
working folder), or an entry point of the group `archerfish.controllers`, `archerfish.motions`, `archerfish.plants` or
`archerfish.worlds`. Names come from the command line or from Python: code that a data file names is never run.

A file is run once for each content that it has: a file that was edited is another module with another digest. An
object, as a function of a notebook, gets a name by its content, too, for records that have a text there.
"""

import functools
import hashlib
import importlib.util
import operator
import sys
import types
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from archerfish.errors import InputError, one_line
from archerfish.object_digest import object_digest, sources

FORMS = "./FILE.py:NAME, MODULE:NAME or the name of an installed entry point"
_TRACED = ("Tracer", "Concretization", "NonConcrete", "UnexpectedTracer")  # JAX's errors of code that can't be compiled
_executed: dict[str, str] = {}  # module that was run from a file → SHA-256 of what was run
_OBJECT = "<object "  # begin of an object's name
_objects: dict[str, "Plugin"] = {}  # by the names of `registered_name`


@dataclass(frozen=True, eq=False)
class Plugin:
    """Something of a user's own."""

    spec: str
    """Its name, with the full path of a file."""
    name: str
    """By which results call it."""
    value: Any
    """What the name stands for in the user's code."""
    file: str
    """Its source; "" where it has none."""
    ran: str = ""
    """SHA-256 of the file that was run, for what stands in it under the name; "" for any other object."""

    @functools.cached_property
    def digest(self) -> str:
        """SHA-256 of the file that was run, else of the object's content; "" where the object can't be digested."""
        return self.ran or object_digest(self.value)

    @contextmanager
    def running(self) -> Iterator[None]:
        """Turn whatever the user's code raises in a block into one line that names its file and the line in it.

        Of what is Archerfish's own, a fault keeps its traceback.

        Raises:
          InputError: in the place of any other exception, and before another `InputError` the name of the code.
        """
        if getattr(self.value, "__module__", "").startswith(f"{__package__}."):
            yield
            return
        try:
            yield
        except InputError as error:
            text = str(error)
            raise (error if text.startswith(self.spec) else InputError(f"{self.spec}: {text}")) from error
        except (Exception, SystemExit) as error:
            import traceback  # slow to load

            frames = traceback.extract_tb(error.__traceback__)
            lines = [frame.lineno for frame in frames if frame.filename == self.file]
            if isinstance(error, SyntaxError) and error.filename == self.file:
                lines.append(error.lineno)
            place, name = f"line {lines[-1]}: " if lines else "", type(error).__name__
            said = ""
            with suppress(Exception):  # an exception of a user's own may have no text
                said = str(error)
            text = one_line(f"{name}: {(said.strip().splitlines() or [''])[0]}")[:240]
            compiled = "it runs compiled, for many engagements at once: write xp = namespace(x) and xp.where for if"
            remedy = compiled if name.startswith(_TRACED) else "correct it"
            raise InputError(f"{self.spec}: {place}{text}; {remedy}") from error


def names_code(spec: str) -> bool:
    """Whether a name is one of code in a file or module, or of an object, which a data file may not name."""
    return ":" in spec


def names_object(spec: str) -> bool:
    """Whether a name is one that an object has in this process alone."""
    return spec.startswith(_OBJECT)


def registered_name(value: Any, kind: str) -> str:
    """Return a name under which `find_plugin` finds an object from now on, by its content; of a name itself.

    Of several objects of one content, it finds the last that was given.

    Raises:
      InputError: as `find_plugin`.
    """
    if isinstance(value, str):
        return value
    plugin = find_plugin(value, kind)
    name = f"{_OBJECT}{plugin.digest[:16] or id(value)}>:{plugin.name}"
    if name not in _objects or _objects[name].value is not value:
        _objects[name] = plugin
    return name


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
        module, name = getattr(spec, "__module__", ""), getattr(spec, "__name__", type(spec).__name__)
        file = getattr(sys.modules.get(module), "__file__", None) or _cell(spec)
        return Plugin(f"{file}:{name}", name, spec, file, _ran(spec))
    if names_object(spec):
        if spec not in _objects:
            raise InputError(f"{kind} {spec!r} is an object of another process; give the object itself")
        return _objects[spec]
    where, _, name = spec.rpartition(":")
    try:
        path = Path(where if where.endswith(".py") else where.replace(".", "/") + ".py").resolve()
        is_file, attribute = bool(where) and path.is_file() and not _is_installed(where, path), name
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
    plugin = Plugin(spec, name, None, str(path) if is_file else "")
    with plugin.running():
        module = _module(path) if is_file else importlib.import_module(where)
        if not hasattr(module, attribute.partition(".")[0]):
            own = (each for each, value in vars(module).items() if getattr(value, "__module__", "") == module.__name__)
            raise InputError(f"has no {attribute!r}, but {', '.join(own) or 'nothing'}; name one of these")
        value = operator.attrgetter(attribute)(module)
        return replace(plugin, value=value, ran=_executed.get(module.__name__, ""))


def _ran(value: Any) -> str:
    """Return the SHA-256 of the file that was run, of what stands there under its own name; "" for anything else."""
    module, name = getattr(value, "__module__", None), getattr(value, "__qualname__", None)
    with suppress(AttributeError):
        if module in _executed and name and operator.attrgetter(name)(sys.modules[module]) is value:
            return _executed[module]
    return ""


def _cell(value: Any) -> str:
    """Return the name of a notebook's cell, as a traceback has it; "" where there is none."""
    members = vars(value if isinstance(value, type) else type(value)).values()
    functions = [each for each in (value, *members) if isinstance(each, types.FunctionType)]
    names = [function.__code__.co_filename for function in functions]
    return next((name for name in names if not name.startswith("<string")), "")


def _is_installed(where: str, path: Path) -> bool:
    """Whether a name is that of a module which is not the file."""
    with suppress(ImportError, ValueError, AttributeError):
        found = importlib.util.find_spec(where)
        return found is not None and found.origin is not None and Path(found.origin).resolve() != path
    return False


def _module(path: Path) -> types.ModuleType:
    """Run a file, once for each content; not by the import system, which would leave compiled files beside it.

    Its content is that of the files beside it as well that it imports, which are then imported again.
    """
    contents = sources(path)
    digest = hashlib.sha256(b"".join(contents.values())).hexdigest()
    # Not by its stem, which another file may have, and under the package's name, which another edition has not.
    name = f"{__package__}_plugin_{path.stem}_{hashlib.sha256(bytes(path) + digest.encode()).hexdigest()[:8]}"
    if name not in sys.modules:
        module = sys.modules[name] = types.ModuleType(name)
        module.__file__ = str(path)
        beside = [str(path.parent)] if str(path.parent) not in sys.path else []
        for other in contents:
            earlier = getattr(sys.modules.get(other.stem), "__file__", None)
            if earlier == str(other) or (earlier and str(Path(earlier).parent) not in sys.path):
                del sys.modules[other.stem]  # run before, for this or another file of a user's own
        sys.path += beside  # what is installed comes first
        try:
            exec(compile(contents[path], str(path), "exec", dont_inherit=True), module.__dict__)
            _executed[name] = digest
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
