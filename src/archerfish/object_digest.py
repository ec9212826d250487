"""Digest of an object of a user's own, by its content: its code, and all that this refers to.

It is the same in another process, as it has no addresses and no order of hashes. What is installed counts by its name
and its file. An object that refers to what has no content, as a lock or an open file, has no digest.
"""

import ast
import copyreg
import dis
import functools
import hashlib
import operator
import sys
import sysconfig
import types
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from archerfish.storage import file_hash

_PLAIN = (type(None), bool, int, float, complex, str, types.EllipsisType, types.NotImplementedType)
_BUILT_IN = (
    types.MemberDescriptorType,
    types.GetSetDescriptorType,
    types.MethodDescriptorType,
    types.WrapperDescriptorType,
    types.ClassMethodDescriptorType,
)
_CODE = """co_code co_exceptiontable co_consts co_names co_varnames co_freevars co_cellvars co_flags co_argcount
co_posonlyargcount co_kwonlyargcount"""
_STANDARD = sysconfig.get_path("stdlib")
_WRAPPING = ("functools", "jaxlib")  # a cached or jitted function, with state of the process
_PROPERTY = ("fget", "fset", "fdel")
# Of a class: texts, places in a file, caches and what is made of other members.
_NO_CONTENT = """__doc__ __module__ __qualname__ __firstlineno__ __static_attributes__ __dict__ __weakref__ _abc_impl
__slotnames__ __msgspec_cache__ __annotations__ __annotate__ __annotate_func__ __annotations_cache__
__dataclass_fields__ __dataclass_params__ __orig_bases__ __parameters__ __type_params__"""


def object_digest(value: Any) -> str:
    """Return the SHA-256 of an object's content; "" where it refers to something that can't be digested."""
    digest = _Digest({})
    try:
        digest.add(value)
    except Exception:  # whatever the user's __reduce__ and __getattr__ raise
        return ""
    return digest.sha256.hexdigest()


def sources(path: Path) -> dict[Path, bytes]:
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


class _Digest:
    """A digest to which values are added."""

    def __init__(self, seen: dict[int, tuple[int, Any]]) -> None:
        self.sha256 = hashlib.sha256()
        self.seen = seen  # by identity: when it was added, and the value, as another one could get its address

    def add(self, value: Any) -> None:
        """Add a value, and all that it refers to.

        Raises:
          TypeError: if it has no content, and whatever a user's own code raises.
        """
        kind = type(value)
        self._write(kind.__qualname__)
        if kind in _PLAIN:
            self._write(repr(value))
        elif kind is bytes:
            self._write(value)
        elif kind is tuple:
            self._add_all(value)
        elif kind in (set, frozenset):
            self._add_set(value)
        elif kind is types.CodeType:
            self._add_all([getattr(value, name) for name in _CODE.split()])
        elif id(value) in self.seen:
            self._write(f"seen {self.seen[id(value)][0]}")
        else:
            self.seen[id(value)] = len(self.seen), value
            self._add_new(value)

    def _add_new(self, value: Any) -> None:
        if name := _installed_name(value):
            self._write(name)
        elif isinstance(value, types.FunctionType):
            self._add_function(value)
        elif isinstance(value, type):
            self._add_class(value)
        elif isinstance(value, types.ModuleType):
            self._write(_module_text(value))
        elif isinstance(value, types.MethodType):
            self._add_all((value.__func__, value.__self__))
        elif isinstance(value, types.BuiltinFunctionType):
            self._write(value.__name__)
            self.add(value.__self__)
        elif isinstance(value, staticmethod | classmethod):
            self.add(value.__func__)
        elif isinstance(value, functools.cached_property):
            self.add(value.func)  # without its lock
        elif type(value).__module__.partition(".")[0] in _WRAPPING and hasattr(value, "__wrapped__"):
            self.add(value.__wrapped__)
        elif isinstance(value, property):
            self._add_all([getattr(value, name) for name in _PROPERTY])
        elif isinstance(value, _BUILT_IN):
            self._write(value.__name__)
        elif type(value) is list:
            self._add_all(value)
        elif type(value) in (dict, types.MappingProxyType):
            self._add_all([part for item in value.items() for part in item])
        else:
            self._add_instance(value)

    def _add_function(self, function: types.FunctionType) -> None:
        self.add(function.__code__)
        for cell in function.__closure__ or ():
            try:
                self.add(cell.cell_contents)
            except ValueError:  # it is filled later
                self._write("empty")
        self._add_all((function.__defaults__, function.__kwdefaults__, vars(function)))
        module = function.__globals__.get("__name__")
        if _is_installed(module):
            self._write(_module_text(sys.modules[str(module)]))
            return
        for name, used in _globals(function.__code__, function.__globals__):
            self._write(name)
            self.add(used)

    def _add_class(self, made: type) -> None:
        self._add_all((type(made), made.__bases__, getattr(made, "__struct_defaults__", None)))
        for name, member in vars(made).items():
            if name not in _NO_CONTENT.split():
                self._write(name)
                self.add(member)

    def _add_instance(self, value: Any) -> None:
        """Add what a copy would be made of, as pickle takes it, but with its code."""
        self.add(type(value))
        reduce = copyreg.dispatch_table.get(type(value))
        parts = reduce(value) if reduce else value.__reduce_ex__(4)
        if isinstance(parts, str):
            raise TypeError(f"{parts} is known by a name alone")
        for part in parts:
            self.add(list(part) if isinstance(part, Iterator) else part)

    def _add_all(self, values: Any) -> None:
        self._write(str(len(values)))
        for value in values:
            self.add(value)

    def _add_set(self, values: Any) -> None:
        """Add the members in the order of their digests."""
        digests = []
        for value in values:
            digest = _Digest(dict(self.seen))
            digest.add(value)
            digests.append(digest.sha256.hexdigest())
        self._write(" ".join(sorted(digests)))

    def _write(self, text: str | bytes) -> None:
        data = text if isinstance(text, bytes) else text.encode(errors="surrogatepass")
        self.sha256.update(b"%d:" % len(data) + data)


def _globals(code: types.CodeType, names: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield what a function uses of its module by name; of another module of the user's own, what it uses of that."""
    found = [instruction for instruction in dis.get_instructions(code) if instruction.opname != "EXTENDED_ARG"]
    for at, instruction in enumerate(found):
        name = str(instruction.argval)
        if instruction.opname == "IMPORT_NAME" and name in sys.modules:
            yield name, sys.modules[name]
        if instruction.opname not in ("LOAD_GLOBAL", "LOAD_NAME") or name not in names:
            continue
        used = names[name]
        for following in found[at + 1 :]:
            is_own = isinstance(used, types.ModuleType) and not _is_installed(used.__name__)
            if not is_own or following.opname not in ("LOAD_ATTR", "LOAD_METHOD"):
                break
            used = getattr(used, str(following.argval))
        yield name, used
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _globals(constant, names)


def _installed_name(value: Any) -> str:
    """Return the name under which an installed module has a value, and the module's file; "" where none has it."""
    module, name = getattr(value, "__module__", None), getattr(value, "__qualname__", None)
    if isinstance(name, str) and _is_installed(module):
        with suppress(AttributeError):
            if operator.attrgetter(name)(sys.modules[str(module)]) is value:
                return f"{name} of {_module_text(sys.modules[str(module)])}"
    return ""


def _is_installed(name: Any) -> bool:
    """Whether a module is of Python, a package that was installed, or Archerfish."""
    module = sys.modules.get(name) if isinstance(name, str) else None
    if module is None or name == "__main__":
        return False
    if name.partition(".")[0] == __package__:
        return True
    if not getattr(module, "__file__", None):
        return module.__spec__ is not None  # as of what is built in; a notebook has none
    file = Path(str(module.__file__))
    return not {"site-packages", "dist-packages"}.isdisjoint(file.parts) or file.is_relative_to(_STANDARD)


def _module_text(module: types.ModuleType) -> str:
    """Return the name of a module, and the digest of its file as it is now; of a user's own, with what lies beside."""
    file = Path(getattr(module, "__file__", None) or "")
    if file.suffix != ".py" or not file.is_file():
        return module.__name__
    own = not _is_installed(module.__name__)
    digest = hashlib.sha256(b"".join(sources(file).values())).hexdigest() if own else file_hash(file)
    return f"{module.__name__} {digest}"
