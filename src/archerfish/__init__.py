"""Archerfish: from the logs of a two-axis gimbal to a policy that out-shoots classical auto-aim.

The public names are those of `__init__.pyi`, which type checkers read as well. A name loads when it is used, so
importing this imports none of the libraries.
"""

import importlib
from typing import Any

from archerfish.learning import register_environments

__version__ = "0.2.0"

# Read by the loader: the package may lie in a zip file. Each of its lines is: from MODULE import NAME as NAME.
_stub = __spec__.loader.get_data(f"{__path__[0]}/__init__.pyi").decode()  # type: ignore[union-attr]
_modules = {line.split()[3]: line.split()[1] for line in _stub.splitlines() if line.startswith("from ")}
__all__ = [*_modules, "__version__"]


def __getattr__(name: str) -> Any:
    if name not in _modules:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}; it has {', '.join(__all__)}")
    return globals().setdefault(name, getattr(importlib.import_module(_modules[name]), name))


__dir__ = __all__.copy


register_environments()
