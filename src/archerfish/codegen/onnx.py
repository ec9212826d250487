"""A traced decision as an ONNX model: its inputs are those of C, and `memory` and `first`, which the caller keeps.

Every scalar is a tensor of shape (1,). There is no guard: inputs must be finite.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from archerfish.codegen.decision import Decision
from archerfish.codegen.printing import Printer, printed
from archerfish.errors import InputError


def print_onnx(decision: Decision, facts: Mapping[str, Any]) -> bytes:
    """Print a decision as a model.

    Args:
      decision: what is decided.
      facts: for the model's metadata, by name.

    Raises:
      InputError: if the package onnx is not installed.
    """
    try:
        import onnx.inliner
    except ImportError as error:
        raise InputError("the package onnx is not installed; pip install 'archerfish[export]', or export C") from error
    constants: dict[Any, tuple[str, Any]] = {}

    def constant(value: Any) -> str:
        key = (array := np.atleast_1d(value)).dtype.str, array.shape, array.tobytes()
        return constants.setdefault(key, (f"k{len(constants)}", array))[0]

    printer = Printer(lambda value: constant(value if isinstance(value, bool | np.bool_) else np.float32(value)))
    content: dict[str, Any] = {"zero": printer.number(0.0), "number": printer.number}
    content |= {"indices": lambda *numbers: constant(np.array(numbers)), "pair": lambda *at: constant(np.array([at]))}
    text = printed("decision.onnx.jinja", printer, decision, content)
    model = onnx.parser.parse_model(text)
    constants |= {at: (f"table_{at}", table) for at, table in enumerate(printer.tables)}
    model.graph.initializer.extend(onnx.numpy_helper.from_array(array, name) for name, array in constants.values())
    model = onnx.inliner.inline_local_functions(model)  # other runtimes than ONNX Runtime don't know them
    del model.opset_import[1:]
    onnx.helper.set_model_props(model, {name: str(value) for name, value in facts.items()})
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString())
