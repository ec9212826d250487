"""Each operation on symbols, run by ONNX Runtime, gives what NumPy gives."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.deployment.onnx_model import onnx_model
from archerfish.deployment.symbol import BATCH, graph_input, in_order
from archerfish.deployment.symbolic_arrays import SYMBOLIC
from archerfish.dynamics.array_namespace import if_any, lift, namespace, repeat

CONSTANT = np.array([0.5, -2.0, 3.0], np.float32)


def run(function: Callable[..., Any], *arrays: np.ndarray) -> Any:
    """Run a function in ONNX Runtime."""
    onnxruntime = pytest.importorskip("onnxruntime")
    pytest.importorskip("onnx")
    symbols = [graph_input(f"x{index}", each.shape[1:], each.dtype) for index, each in enumerate(arrays)]
    result = function(*symbols)
    model = onnx_model({"result": result}, {}, "0", "")
    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    used = {each.name for each in session.get_inputs()}
    feed = {f"x{index}": each for index, each in enumerate(arrays) if f"x{index}" in used}
    found = session.run(None, feed)[0]
    assert result.shape == (BATCH, *found.shape[1:])
    assert result.dtype == found.dtype
    return found


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "arithmetic with constants on both sides": lambda xp, x: 2.0 * x / (1.5 - x**2) - CONSTANT * -x + x / CONSTANT,
    "a NumPy scalar on the left": lambda xp, x: np.float32(2.0) * x,
    "comparison and choice": lambda xp, x: xp.where((x > 0.5) & ~(x >= 2.0) | (x == 0.0), x, -CONSTANT),
    "less": lambda xp, x: xp.where((x < 0.5) & (x <= 0.2), 1.0, x),
    "a truth value as a number": lambda xp, x: (x > 0.0) + 1.0,
    "clip": lambda xp, x: xp.clip(x, -1.0, CONSTANT),
    "magnitude, sign and rounding": lambda xp, x: xp.abs(x) + xp.sign(x) + xp.floor(x),
    "bounds": lambda xp, x: xp.maximum(x, 0.1) - xp.minimum(CONSTANT, x),
    "root and tanh": lambda xp, x: xp.tanh(x) * xp.sqrt(x * x + 1.0),
    "sine and cosine": lambda xp, x: xp.sin(x) + 2.0 * xp.cos(x),
    "exponential": lambda xp, x: xp.exp(x),
    "logarithm": lambda xp, x: xp.log(xp.maximum(x, 1e-30)),
    "largest": lambda xp, x: xp.max(x, axis=-1, keepdims=True) * xp.max(x, axis=-1)[..., None],
    "one number": lambda xp, x: x[..., 1],
    "the last number": lambda xp, x: x[..., -1],
    "a part": lambda xp, x: x[..., 1:],
    "new axes": lambda xp, x: x[..., :, None] * x[..., None, :],
    "a new axis in front of a part": lambda xp, x: x[..., None, -2:],
    "join": lambda xp, x: xp.concat([x, 2.0 * x[..., :1]], axis=-1),
    "stack": lambda xp, x: xp.stack([x, -x], axis=-2),
    "transpose": lambda xp, x: xp.matrix_transpose(x[..., None, :] * CONSTANT[:, None]),
    "reshape": lambda xp, x: xp.reshape(x[..., :, None] * x[..., None, :], (*x.shape[:-1], -1)),
    "sums": lambda xp, x: xp.sum(x, axis=-1, keepdims=True) * xp.sum(x, axis=-1)[..., None],
    "matrix product": lambda xp, x: x @ np.outer(CONSTANT, CONSTANT[:2]),
    "a lifted parameter": lambda xp, x: lift(CONSTANT, x) * x,
    "of constants alone": lambda xp, x: x * xp.sum(xp.stack([xp.abs(xp.eye(3)[0]), CONSTANT], axis=0), axis=0),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_an_operation_gives_what_numpy_gives(name) -> None:
    x = np.random.default_rng(1).normal(0.0, 2.0, (7, 3)).astype(np.float32)
    x[0] = [0.0, 0.2, 0.5]
    function = FUNCTIONS[name]
    assert_allclose(run(lambda x: function(namespace(x), x), x), function(np, x), rtol=2e-6, atol=1e-6)


def test_the_arctangent_is_right_in_all_quadrants_and_at_all_edges() -> None:
    sizes = np.array([0.0, 1e-38, 1e-7, 1.0, 3.0, 1e30, np.inf], np.float32)
    edges = np.concatenate([sizes, -sizes])
    circle = np.linspace(-math.pi, math.pi, 4001).astype(np.float32)
    y = np.concatenate([np.repeat(edges, len(edges)), np.sin(circle)])
    x = np.concatenate([np.tile(edges, len(edges)), np.cos(circle)])
    found = run(SYMBOLIC.atan2, y, x)
    # Two units in the last place of π. The signs of zeros decide between −π and π, as in NumPy.
    assert_allclose(found, np.arctan2(y, x), atol=5e-7, rtol=3e-7)


@pytest.mark.parametrize("name", ["expm1", "log1p"])
def test_small_numbers_keep_their_digits(name) -> None:
    sizes = np.geomspace(1e-9, 0.9, 400)
    x = np.concatenate([-sizes, [0.0], sizes, [2.0, 10.0, 50.0]]).astype(np.float32)
    assert_allclose(run(getattr(SYMBOLIC, name), x), getattr(np, name)(x.astype(np.float64)), rtol=1e-6)


def test_nan_is_never_swallowed() -> None:
    x = np.full(2, np.nan, np.float32)
    for function in (
        lambda x: SYMBOLIC.clip(x, -1.0, 1.0),
        lambda x: SYMBOLIC.maximum(x, 0.0),
        lambda x: SYMBOLIC.atan2(x, 1.0 + 0.0 * x),
        SYMBOLIC.tanh,
        SYMBOLIC.expm1,
    ):
        assert np.all(np.isnan(run(function, x)))


def test_what_is_computed_twice_is_in_the_graph_once() -> None:
    onnx = pytest.importorskip("onnx")
    x = graph_input("x", (3,))
    result = SYMBOLIC.tanh(x * CONSTANT) + SYMBOLIC.tanh(x * CONSTANT.copy())
    model = onnx.load_from_string(onnx_model({"result": result}, {"unit": "rad"}, "0", ""))
    assert [each.op_type for each in model.graph.node] == ["Mul", "Tanh", "Add", "Identity"]
    assert len(in_order([result])) == 6
    assert {each.key: each.value for each in model.metadata_props} == {"unit": "rad"}
    assert [each.version for each in model.opset_import] == [17]


@pytest.mark.parametrize(
    ("function", "complaint"),
    [
        (lambda x: 1.0 if x[0, 0] else 0.0, "is the batch, which can't be cut"),
        (lambda x: bool(x[..., 0] > 0.0), "has no truth value"),
        (lambda x: x[..., ::2], "without strides"),
        (lambda x: x[..., [0, 1]], "takes numbers and slices"),
        (lambda x: x + np.ones(2), "don't fit together"),
        (lambda x: x**0.5, "whole powers"),
        (lambda x: x @ np.ones((2, 2)), "no product of shapes"),
        (lambda x: SYMBOLIC.reshape(x, (BATCH, 4)), "no reshape"),
        (lambda x: SYMBOLIC.reshape(x, (-1,)), "keeps the batch first"),
        (lambda x: SYMBOLIC.concat([x, x[..., None]], axis=-1), "can't be joined"),
        (lambda x: x[..., 3], "index 3 is out of range"),
        (lambda x: x[..., -4], "index -4 is out of range"),
        (lambda x: x[..., True], "takes numbers and slices"),
        (lambda x: x[..., 0, 0, 0], "too many"),
        (lambda x: (x > 0.0) + (x < 1.0), "Add of truth values"),
        (lambda x: (x > 0.0) * np.array(True), "Mul of truth values"),
        (lambda x: SYMBOLIC.maximum(x > 0.0, x < 1.0), "Max of truth values"),
        (lambda x: SYMBOLIC.asarray(x, np.int32), "can't be made one of int32"),
        (lambda x: x + None, "meets numbers"),
        (lambda x: SYMBOLIC.where(x > 0.0, x, None), "meets numbers"),
        (lambda x: repeat(lambda each: each + 1.0, 2, x), "repeat is of NumPy's arrays and JAX's"),
        (lambda x: if_any(x > 0.0, lambda: x, lambda: x), "if_any is of NumPy's arrays and JAX's"),
    ],
)
def test_what_onnx_can_not_say_is_refused(function, complaint) -> None:
    with pytest.raises(TypeError, match=complaint):
        function(graph_input("x", (3,)))
