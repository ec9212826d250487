"""Any controller as a C file or an ONNX model, traced from the formulas that run here.

The package has the name of its function, so it is called like it: `archerfish2.export(policy, "policy.c")`.
"""

import sys
from types import ModuleType
from typing import Any


class _Package(ModuleType):
    def __call__(self, *arguments: Any, **named: Any) -> Any:
        from archerfish2.export.export import export

        return export(*arguments, **named)


sys.modules[__name__].__class__ = _Package
