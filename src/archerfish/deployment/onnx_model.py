"""A graph of symbols as an ONNX model."""

from collections.abc import Mapping
from typing import Any

from archerfish.deployment.symbol import BOOL, Constant, Symbol, in_order
from archerfish.records.errors import InputError

OPSET = 17
IR_VERSION = 8
"""The file format that came with that opset: runtimes of 2022 on read it."""


def onnx_model(outputs: Mapping[str, Symbol], metadata: Mapping[str, str], producer_version: str, about: str) -> bytes:
    """Return an ONNX model, checked by ONNX's own checker.

    Args:
      outputs: name → symbol; inputs are whatever these depend on.
      metadata: name → text.
      producer_version: version of this package.
      about: a few words for whoever opens the file.

    Raises:
      InputError: if the package onnx is missing.
    """
    try:
        import onnx
    except ImportError as error:
        raise InputError("writing ONNX needs onnx, which is not installed; pip install 'archerfish[export]'") from error
    names, nodes, constants, inputs = _named(outputs)
    helper = onnx.helper
    given = [helper.make_tensor_value_info(each.name, _kind(onnx, each), each.shape) for each in inputs]
    taken = [helper.make_tensor_value_info(name, _kind(onnx, each), each.shape) for name, each in outputs.items()]
    operations = [
        helper.make_node(each.operation, list(takes), [names[each.serial]], **_attributes(each))
        for each, takes in nodes
    ]
    operations += [helper.make_node("Identity", [names[each.serial]], [name]) for name, each in outputs.items()]
    initializers = [onnx.numpy_helper.from_array(array, name) for name, array in constants.items()]
    graph = helper.make_graph(operations, "decision", given, taken, initializers, doc_string=about)
    opsets = [helper.make_opsetid("", OPSET)]
    model = helper.make_model(
        graph,
        opset_imports=opsets,
        ir_version=IR_VERSION,
        producer_name="archerfish",
        producer_version=producer_version,
        doc_string=about,
    )
    helper.set_model_props(model, dict(metadata))
    onnx.checker.check_model(model, full_check=True)
    return bytes(model.SerializeToString())


def _attributes(symbol: Symbol) -> dict[str, Any]:
    return dict(symbol.attributes)


def _kind(onnx: Any, symbol: Symbol) -> int:
    return int(onnx.TensorProto.BOOL if symbol.dtype == BOOL else onnx.TensorProto.FLOAT)


def _named(
    outputs: Mapping[str, Symbol],
) -> tuple[dict[int, str], list[tuple[Symbol, tuple[str, ...]]], dict[str, Constant], list[Symbol]]:
    """Name every value; what is computed twice, or held twice, is there once."""
    names: dict[int, str] = {}
    known: dict[Any, str] = {}
    constants: dict[str, Constant] = {}
    nodes: list[tuple[Symbol, tuple[str, ...]]] = []
    inputs: list[Symbol] = []

    def name_of(value: Symbol | Constant) -> str:
        if isinstance(value, Symbol):
            return names[value.serial]
        key = (value.dtype.str, value.shape, value.tobytes())
        name = known.setdefault(key, f"constant_{len(constants)}")
        constants.setdefault(name, value)
        return name

    for symbol in in_order(list(outputs.values())):
        if not symbol.operation:
            names[symbol.serial] = symbol.name
            inputs.append(symbol)
            continue
        takes = tuple(name_of(each) for each in symbol.inputs)
        key = (symbol.operation, takes, symbol.attributes)
        if key not in known:
            known[key] = f"{symbol.operation.lower()}_{len(nodes)}"
            nodes.append((symbol, takes))
        names[symbol.serial] = known[key]
    return names, nodes, constants, inputs
