"""Code of a user's own: found by its name, and passed on as an object.

A name says where it is: `./file.py:Name`, `module:Name` (an installed module, or else a file of that name in the
working folder), or an entry point of the group `archerfish.controllers`, `archerfish.motions`, `archerfish.plants` or
`archerfish.worlds`. Names come from the command line or from Python: code that a data file names is never run.

A file is run once for each content that it has: a file that was edited is another module with another digest. An
object, as a function of a notebook, gets a name by its content, too, for records that have a text there.
"""

import ast
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

from archerfish2.errors import InputError, one_line
from archerfish2.storage import file_hash

FORMS = "./FILE.py:NAME, MODULE:NAME or the name of an installed entry point"
_TRACED = ("Tracer", "Concretization", "NonConcrete", "UnexpectedTracer")  # JAX's errors of code that can't be compiled
_executed: dict[str, str] = {}  # module that was run from a file → SHA-256 of what was run
_OBJECT = "<object "  # begin of an object's name
_objects: dict[str, "Plugin"] = {}  # by the names of `name_of`


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
    digest: str = ""
    """SHA-256 of the file's content that was run; of an object from an imported module, of the file as it is now; of
    one without a file, as in a notebook, of its source and what that refers to; "" where it has none."""

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
            text = one_line(f"{name}: {(str(error).strip().splitlines() or [''])[0]}")[:240]
            compiled = "it runs compiled, for many engagements at once: write xp = namespace(x) and xp.where for if"
            remedy = compiled if name.startswith(_TRACED) else "correct it"
            raise InputError(f"{self.spec}: {place}{text}; {remedy}") from error


def names_code(spec: str) -> bool:
    """Whether a name is one of code in a file or module, or of an object, which a data file may not name."""
    return ":" in spec


def names_object(spec: str) -> bool:
    """Whether a name is one that an object has in this process alone."""
    return spec.startswith(_OBJECT)


def name_of(value: Any, kind: str) -> str:
    """Return the name of an object of a user's own, by its content, as `find_plugin` takes it; of a name itself.

    Raises:
      InputError: as `find_plugin`.
    """
    if isinstance(value, str):
        return value
    plugin = find_plugin(value, kind)
    name = f"{_OBJECT}{_source_digest(value)[:8] or id(value)}>:{plugin.name}"
    _objects.setdefault(name, plugin)
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
        return Plugin(f"{file}:{name}", name, spec, file, _digest_of(module, file) or _source_digest(spec))
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
        digest = _digest_of(module.__name__, module.__file__ or "")
        return replace(plugin, value=operator.attrgetter(attribute)(module), digest=digest)


def _digest_of(module: str, file: str) -> str:
    """Return the SHA-256 of what was run as a module, or of its file as it is now; "" without either."""
    return _executed.get(module) or (file_hash(Path(file)) if Path(file).is_file() else "")


def _functions(value: Any) -> list[Any]:
    """Return the functions that an object, or its class, is made of."""
    if isinstance(value, types.FunctionType):
        return [value]
    members = vars(value if isinstance(value, type) else type(value)).values()
    return [each for each in members if isinstance(each, types.FunctionType)]


def _cell(value: Any) -> str:
    """Return the name of a notebook's cell, as a traceback has it; "" where there is none."""
    names = [function.__code__.co_filename for function in _functions(value)]
    return next((name for name in names if not name.startswith("<string")), "")


def _source_digest(value: Any) -> str:
    """Return the SHA-256 of an object's source and of what that refers to; "" where the source is not kept."""
    found = dict[Any, str]()
    _collect(value, found)
    state = "" if isinstance(value, type | types.FunctionType) else repr(getattr(value, "__dict__", value))
    return hashlib.sha256("".join((*found.values(), state)).encode()).hexdigest() if any(found.values()) else ""


def _collect(value: Any, found: dict[Any, str]) -> None:
    """Add the source of an object's functions, and of what they use: numbers and texts, and their module's code."""
    import inspect

    for function in _functions(value):
        if function in found:
            continue
        found[function] = ""
        with suppress(OSError, TypeError, ValueError):
            parts, codes = [inspect.getsource(function)], [function.__code__]
            parts += [repr([cell.cell_contents for cell in function.__closure__ or ()])]
            parts += [repr((function.__defaults__, function.__kwdefaults__))]
            for code in codes:  # which grows by those inside
                codes += [constant for constant in code.co_consts if isinstance(constant, types.CodeType)]
                parts += [_compiled(code)]  # of two functions in one line, the source is the same
            for name in dict.fromkeys(name for code in codes for name in code.co_names):
                used = function.__globals__.get(name)
                if isinstance(used, bool | int | float | str | tuple | list):
                    parts += [f"{name} = {used!r}"]
                elif isinstance(used, type | types.FunctionType) and used.__module__ == function.__module__:
                    _collect(used, found)
            found[function] = "\n".join(parts)


def _compiled(code: types.CodeType) -> str:
    """Return what a function does, without the functions inside; the same in every process."""
    constants = [constant for constant in code.co_consts if not isinstance(constant, types.CodeType)]
    # A set has another order in each process.
    texts = [str(sorted(map(repr, value))) if isinstance(value, frozenset) else repr(value) for value in constants]
    return repr((code.co_code, code.co_names, code.co_varnames, texts))


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
    sources = _sources(path)
    digest = hashlib.sha256(b"".join(sources.values())).hexdigest()
    # Not by its stem, which another file may have, and under the package's name, which another edition has not.
    name = f"{__package__}_plugin_{path.stem}_{hashlib.sha256(bytes(path) + digest.encode()).hexdigest()[:8]}"
    if name not in sys.modules:
        module = sys.modules[name] = types.ModuleType(name)
        module.__file__ = str(path)
        beside = [str(path.parent)] if str(path.parent) not in sys.path else []
        for other in sources:
            earlier = getattr(sys.modules.get(other.stem), "__file__", None)
            if earlier == str(other) or (earlier and str(Path(earlier).parent) not in sys.path):
                del sys.modules[other.stem]  # run before, for this or another file of a user's own
        sys.path += beside  # what is installed comes first
        try:
            exec(compile(sources[path], str(path), "exec", dont_inherit=True), module.__dict__)
            _executed[name] = digest
        except BaseException:
            del sys.modules[name]
            raise
        finally:
            for each in beside:
                sys.path.remove(each)
    return sys.modules[name]


def _sources(path: Path) -> dict[Path, bytes]:
    """Return the content of a file, and of those beside it that it imports, directly or by others."""
    found, waiting = dict[Path, bytes](), [path]
    while waiting:
        file = waiting.pop(0)
        if file in found or not file.is_file():
            continue
        found[file] = file.read_bytes()
        with suppress(SyntaxError, ValueError):  # which are named when the file is run
            for node in ast.walk(ast.parse(found[file])):
                names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
                names += [node.module] if isinstance(node, ast.ImportFrom) and node.module else []
                waiting += [path.parent / f"{name.partition('.')[0]}.py" for name in names]
    return found


def _entry_points(kind: str) -> Any:
    # Imported here, as it is slow to load.
    return importlib.import_module("importlib.metadata").entry_points(group=f"archerfish.{kind}s")
