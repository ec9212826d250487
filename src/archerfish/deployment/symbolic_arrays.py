"""The array functions for symbols: what `namespace()` finds, by the names of the Python array API standard.

ONNX has no atan2, expm1 and log1p. They are built here from what it has, with the accuracy of float32 kept where the
obvious formula would lose it, and with NumPy's answers in all quadrants, signed zeros included.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from archerfish.deployment.symbol import BOOL, FLOAT, Shape, Symbol, arithmetic, elementwise, expanded, operand
from archerfish.deployment.symbol import reshaped as _reshaped

_SERIES_BELOW = 0.25
"""Of |x|: series for expm1 and log1p below, where 1 would swallow the digits of x."""


class SymbolicArrays:
    """An array namespace; on NumPy arrays alone it is NumPy's, so that constants stay constants."""

    def asarray(self, value: Any, dtype: Any = None) -> Any:
        """Return a symbol as it is, anything else as a NumPy array.

        Raises:
          TypeError: if a symbol is to become another type.
        """
        if not isinstance(value, Symbol):
            return np.asarray(value, dtype)
        if dtype is not None and np.dtype(dtype) != value.dtype:
            raise TypeError(f"a symbolic array of {value.dtype} can't be made one of {np.dtype(dtype)}")
        return value

    def eye(self, size: int, dtype: Any = None) -> Any:
        """Return the unit matrix, shape (size, size)."""
        return np.eye(size, dtype=dtype)

    def abs(self, x: Any) -> Any:
        """Return the magnitude."""
        return _numbers("Abs", np.abs, x)

    def sqrt(self, x: Any) -> Any:
        """Return the square root."""
        return _numbers("Sqrt", np.sqrt, x)

    def floor(self, x: Any) -> Any:
        """Round down."""
        return _numbers("Floor", np.floor, x)

    def sign(self, x: Any) -> Any:
        """Return −1, 0 or 1."""
        return _numbers("Sign", np.sign, x)

    def tanh(self, x: Any) -> Any:
        """Return the hyperbolic tangent."""
        return _numbers("Tanh", np.tanh, x)

    def exp(self, x: Any) -> Any:
        """Return e to a power."""
        return _numbers("Exp", np.exp, x)

    def log(self, x: Any) -> Any:
        """Return the natural logarithm."""
        return _numbers("Log", np.log, x)

    def sin(self, x: Any) -> Any:
        """Return the sine."""
        return _numbers("Sin", np.sin, x)

    def cos(self, x: Any) -> Any:
        """Return the cosine."""
        return _numbers("Cos", np.cos, x)

    def maximum(self, x: Any, y: Any) -> Any:
        """Return the larger."""
        return _numbers("Max", np.maximum, x, y)

    def minimum(self, x: Any, y: Any) -> Any:
        """Return the smaller."""
        return _numbers("Min", np.minimum, x, y)

    def clip(self, x: Any, low: Any, high: Any) -> Any:
        """Bound from below and above."""
        return self.minimum(self.maximum(x, low), high)

    def where(self, condition: Any, yes: Any, no: Any) -> Any:
        """Choose by a condition."""
        if not _symbolic(condition, yes, no):
            return np.where(condition, yes, no)
        return elementwise("Where", FLOAT, operand(condition, BOOL), operand(yes), operand(no))

    def concat(self, arrays: Sequence[Any], axis: int = 0) -> Any:
        """Join along an axis."""
        if not _symbolic(*arrays):
            return np.concat(arrays, axis=axis)
        axis %= len(arrays[0].shape)
        shape = list(arrays[0].shape)
        if any((*each.shape[:axis], *each.shape[axis + 1 :]) != (*shape[:axis], *shape[axis + 1 :]) for each in arrays):
            raise TypeError(f"shapes {', '.join(str(each.shape) for each in arrays)} can't be joined along axis {axis}")
        shape[axis] = sum(each.shape[axis] for each in arrays)
        parts = tuple(operand(each) for each in arrays)
        return Symbol("Concat", parts, tuple(shape), FLOAT, "", (("axis", axis),))

    def stack(self, arrays: Sequence[Any], axis: int = 0) -> Any:
        """Join along a new axis."""
        if not _symbolic(*arrays):
            return np.stack(arrays, axis=axis)
        axis %= arrays[0].ndim + 1
        return self.concat([expanded(each, axis) for each in arrays], axis=axis)

    def reshape(self, x: Any, shape: Any) -> Any:
        """Return the same numbers in another shape."""
        return _reshaped(x, tuple(shape)) if _symbolic(x) else np.reshape(x, shape)

    def matrix_transpose(self, x: Any) -> Any:
        """Swap the last two axes."""
        if not _symbolic(x):
            return np.matrix_transpose(x)
        order = (*range(x.ndim - 2), x.ndim - 1, x.ndim - 2)
        return Symbol("Transpose", (x,), tuple(x.shape[each] for each in order), x.dtype, "", (("perm", order),))

    def sum(self, x: Any, axis: int, keepdims: bool = False) -> Any:
        """Add up along an axis."""
        if not _symbolic(x):
            return np.sum(x, axis=axis, keepdims=keepdims)
        axis %= x.ndim
        inputs = (x, np.array([axis], np.int64))
        return Symbol("ReduceSum", inputs, _without(x, axis, keepdims), FLOAT, "", (("keepdims", int(keepdims)),))

    def max(self, x: Any, axis: int, keepdims: bool = False) -> Any:
        """Return the largest along an axis."""
        if not _symbolic(x):
            return np.max(x, axis=axis, keepdims=keepdims)
        axis %= x.ndim
        attributes = (("axes", (axis,)), ("keepdims", int(keepdims)))
        return Symbol("ReduceMax", (x,), _without(x, axis, keepdims), FLOAT, "", attributes)

    def atan2(self, y: Any, x: Any) -> Any:
        """Return the angle of (x, y), −π…π.

        The arctangent of the smaller over the larger is exact to the last bits and never overflows; the octant follows
        from comparisons. At the origin it is what the signs of the zeros say, as in NumPy.
        """
        if not _symbolic(y, x):
            return np.arctan2(y, x)
        wide, high = self.abs(x), self.abs(y)
        larger = self.maximum(wide, high)
        ratio = self.minimum(wide, high) / self.where(larger == 0.0, 1.0, larger)
        # Of two infinities, too, the smaller is all of the larger.
        ratio = self.where((wide == high) & (larger > 0.0), 1.0, ratio)
        angle = _numbers("Atan", np.arctan, ratio)
        angle = self.where(high > wide, math.pi / 2 - angle, angle)
        angle = self.where(_is_negative(x), math.pi - angle, angle)
        return self.where(_is_negative(y), -angle, angle)

    def expm1(self, x: Any) -> Any:
        """Return e to a power, less one."""
        if not _symbolic(x):
            return np.expm1(x)
        # x + x²/2! + …: six terms leave less than 5e-8 of it.
        series = _horner(x, [1.0 / math.factorial(power) for power in range(1, 7)])
        return self.where(self.abs(x) < _SERIES_BELOW, x * series, self.exp(x) - 1.0)

    def log1p(self, x: Any) -> Any:
        """Return the logarithm of one more."""
        if not _symbolic(x):
            return np.log1p(x)
        # 2 artanh(s) with s = x / (2 + x), |s| < 1/7: four terms of 2 s (1 + s²/3 + …) leave less than 2e-8 of it.
        share = x / (2.0 + x)
        series = 2.0 * share * _horner(share * share, [1.0 / (2 * power + 1) for power in range(4)])
        return self.where(self.abs(x) < _SERIES_BELOW, series, self.log(1.0 + x))


SYMBOLIC = SymbolicArrays()
"""The namespace."""


def _symbolic(*values: Any) -> bool:
    return any(isinstance(each, Symbol) for each in values)


def _numbers(operation: str, numpy_function: Callable[..., Any], *values: Any) -> Any:
    return arithmetic(operation, *values) if _symbolic(*values) else numpy_function(*values)


def _without(x: Symbol, axis: int, keepdims: bool) -> Shape:
    """Return the shape of an array of which one axis is summed up, or the like."""
    return (*x.shape[:axis], *((1,) if keepdims else ()), *x.shape[axis + 1 :])


def _is_negative(x: Any) -> Any:
    """Whether the sign is minus, also that of a zero, which shows in its inverse alone."""
    return (x < 0.0) | (1.0 / x < 0.0) if _symbolic(x) else np.signbit(x)


def _horner(x: Any, coefficients: Sequence[float]) -> Any:
    result: Any = coefficients[-1]
    for each in reversed(coefficients[:-1]):
        result = each + x * result
    return result
