"""The name of the environments in Gymnasium, which may be imported before this package or after it."""

import importlib.util
import sys
from typing import Any

PACKAGE = __name__.partition(".")[0]


def name_environments() -> None:
    """Give the environments their name in Gymnasium: now if it is loaded, else when it is, which this doesn't do."""
    if (gymnasium := sys.modules.get("gymnasium")) is not None:
        _register(gymnasium)
    else:
        sys.meta_path.insert(0, _WhenImported())


def _register(gymnasium: Any) -> None:
    place = f"{PACKAGE}.learning.gymnasium:Shooting"
    gymnasium.register(f"{PACKAGE}/Shooting-v0", entry_point=f"{place}Env", vector_entry_point=f"{place}VectorEnv")


class _WhenImported:
    """A finder that is asked for every import, and adds the registration to that of Gymnasium."""

    looking = False

    def find_spec(self, name: str, *_: Any) -> Any:
        if name != "gymnasium" or self.looking:
            return None
        self.looking = True
        try:
            spec: Any = importlib.util.find_spec(name)
        finally:
            self.looking = False
        if spec is not None:
            load = spec.loader.exec_module

            def load_and_register(module: Any) -> None:
                sys.meta_path.remove(self)
                load(module)
                _register(module)

            spec.loader.exec_module = load_and_register
        return spec
