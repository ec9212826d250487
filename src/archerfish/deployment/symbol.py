"""An array that isn't there yet: operations on it are written down instead of done.

The functions of `dynamics`, `sensing` and `controllers` take their array functions from their arguments, so handed
symbols they leave the graph of what they would have computed. A formula stays written once; the operations are those
of ONNX, which are few.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from types import EllipsisType
from typing import Any

import numpy as np
from numpy.typing import NDArray

BATCH = "batch"
"""The one dimension whose size is open; it comes first."""

Constant = NDArray[Any]
Shape = tuple[int | str, ...]
Index = int | slice | EllipsisType | None

_serial = itertools.count()


@dataclass(frozen=True, eq=False)
class Symbol:
    """The result of an operation: an array of float32 or bool, of known shape but for the batch."""

    operation: str
    """Name in ONNX; empty for an input of the graph."""
    inputs: "tuple[Symbol | Constant, ...]"
    """What it takes; scalars have shape ()."""
    shape: Shape
    """Sizes, `BATCH` for the open one."""
    dtype: np.dtype[Any]
    """float32 or bool."""
    name: str = ""
    """Of an input of the graph."""
    attributes: tuple[tuple[str, int | tuple[int, ...]], ...] = ()
    """Of the operation."""
    serial: int = field(default_factory=lambda: next(_serial))
    """Symbols in this order are in the order of computation."""

    __array_ufunc__ = None  # a NumPy array on the left leaves the operation to us

    @property
    def ndim(self) -> int:
        """Number of dimensions."""
        return len(self.shape)

    def __array_namespace__(self) -> Any:
        from archerfish.deployment.symbolic_arrays import SYMBOLIC  # which is built on this module

        return SYMBOLIC

    def __bool__(self) -> bool:
        raise TypeError("a symbolic array has no truth value: what depends on data must be said with where()")

    def __add__(self, other: Any) -> "Symbol":
        return arithmetic("Add", self, other)

    def __radd__(self, other: Any) -> "Symbol":
        return arithmetic("Add", other, self)

    def __sub__(self, other: Any) -> "Symbol":
        return arithmetic("Sub", self, other)

    def __rsub__(self, other: Any) -> "Symbol":
        return arithmetic("Sub", other, self)

    def __mul__(self, other: Any) -> "Symbol":
        return arithmetic("Mul", self, other)

    def __rmul__(self, other: Any) -> "Symbol":
        return arithmetic("Mul", other, self)

    def __truediv__(self, other: Any) -> "Symbol":
        return arithmetic("Div", self, other)

    def __rtruediv__(self, other: Any) -> "Symbol":
        return arithmetic("Div", other, self)

    def __neg__(self) -> "Symbol":
        return arithmetic("Neg", self)

    def __pow__(self, power: int) -> "Symbol":
        if not isinstance(power, int) or power < 1:
            raise TypeError(f"a symbolic array has whole powers from 1 on, got {power!r}")
        result = self
        for _ in range(power - 1):
            result = result * self
        return result

    def __matmul__(self, other: Any) -> "Symbol":
        other = operand(other)
        if self.ndim < 2 or len(other.shape) != 2 or self.shape[-1] != other.shape[0]:
            raise TypeError(f"no product of shapes {self.shape} and {other.shape}")
        return Symbol("MatMul", (self, other), (*self.shape[:-1], other.shape[1]), FLOAT)

    def __lt__(self, other: Any) -> "Symbol":
        return arithmetic("Less", self, other, dtype=BOOL)

    def __le__(self, other: Any) -> "Symbol":
        return arithmetic("LessOrEqual", self, other, dtype=BOOL)

    def __gt__(self, other: Any) -> "Symbol":
        return arithmetic("Greater", self, other, dtype=BOOL)

    def __ge__(self, other: Any) -> "Symbol":
        return arithmetic("GreaterOrEqual", self, other, dtype=BOOL)

    def __eq__(self, other: object) -> "Symbol":  # type: ignore[override]
        return arithmetic("Equal", self, other, dtype=BOOL)

    __hash__ = object.__hash__

    def __and__(self, other: Any) -> "Symbol":
        return elementwise("And", BOOL, self, operand(other, BOOL))

    def __or__(self, other: Any) -> "Symbol":
        return elementwise("Or", BOOL, self, operand(other, BOOL))

    def __invert__(self) -> "Symbol":
        return elementwise("Not", BOOL, self)

    def __getitem__(self, index: Index | tuple[Index, ...]) -> "Symbol":
        return indexed(self, index if isinstance(index, tuple) else (index,))

    def reshape(self, shape: Shape) -> "Symbol":
        """Return the same numbers in another shape, in which at most one size may be −1."""
        return reshaped(self, shape)


FLOAT, BOOL = np.dtype(np.float32), np.dtype(np.bool_)
_KEEP_TRUTH_VALUES = frozenset({"Add", "Sub", "Mul", "Neg", "Abs", "Sign", "Floor", "Max", "Min"})
"""Operations whose answer, of truth values alone, is no number in NumPy."""
ONNX_FLOAT = 1
"""What ONNX calls float32."""


def graph_input(name: str, shape: tuple[int, ...], dtype: np.dtype[Any] = FLOAT) -> Symbol:
    """Return an input of the graph.

    Args:
      name: its name.
      shape: of one member of the batch.
      dtype: float32 or bool.
    """
    return Symbol("", (), (BATCH, *shape), dtype, name)


def operand(value: Any, dtype: np.dtype[Any] = FLOAT) -> "Symbol | Constant":
    """Return a symbol as it is, and anything else as a constant of the type.

    Raises:
      TypeError: if it is no number, truth value or array of them; NumPy would make NaN of None.
    """
    if isinstance(value, Symbol):
        return value
    array = np.asarray(value)
    if array.dtype.kind not in "fiub":
        raise TypeError(f"a symbolic array meets numbers, truth values and arrays of them, got {value!r}")
    return array.astype(dtype)


def arithmetic(operation: str, *values: Any, dtype: np.dtype[Any] = FLOAT) -> Symbol:
    """Return an operation on numbers, element by element; a truth value counts as 0 or 1 beside a number.

    Raises:
      TypeError: if there are truth values alone, of which NumPy makes no number.
    """
    kinds = {each.dtype if isinstance(each, Symbol) else np.asarray(each).dtype for each in values}
    if operation in _KEEP_TRUTH_VALUES and kinds == {BOOL}:
        raise TypeError(f"{operation} of truth values alone is none of numbers in NumPy; say it with &, | and ~")
    return elementwise(operation, dtype, *(_as_number(operand(each)) for each in values))


def elementwise(operation: str, dtype: np.dtype[Any], *values: "Symbol | Constant") -> Symbol:
    """Return an operation element by element, with broadcasting."""
    return Symbol(operation, values, broadcast(*(each.shape for each in values)), dtype)


def _as_number(value: "Symbol | Constant") -> "Symbol | Constant":
    if value.dtype == FLOAT or not isinstance(value, Symbol):
        return value
    return Symbol("Cast", (value,), value.shape, FLOAT, "", (("to", ONNX_FLOAT),))


def broadcast(*shapes: Shape) -> Shape:
    """Return the shape that arrays of some shapes have together.

    Raises:
      TypeError: if they don't fit.
    """
    sizes: list[int | str] = []
    for each in zip(*(((1,) * (max(map(len, shapes)) - len(shape)) + shape) for shape in shapes), strict=True):
        found = {size for size in each if size != 1} or {1}
        if len(found) > 1:
            raise TypeError(f"shapes {', '.join(map(str, shapes))} don't fit together")
        sizes.append(found.pop())
    return tuple(sizes)


def reshaped(array: Symbol, shape: Shape) -> Symbol:
    """Return the same numbers in another shape; the batch stays first.

    Raises:
      TypeError: if the shape does not begin with the batch, or the sizes don't agree.
    """
    sizes = [size for size in shape[1:] if isinstance(size, int)]
    if array.shape[:1] != (BATCH,) or shape[:1] != (BATCH,) or len(sizes) != len(shape) - 1:
        raise TypeError(f"a reshape keeps the batch first, got {array.shape} to {shape}")
    total = int(np.prod([size for size in array.shape[1:] if isinstance(size, int)]))
    known = int(np.prod([size for size in sizes if size != -1]))
    sizes = [total // known if size == -1 else size for size in sizes]
    if int(np.prod(sizes)) != total:
        raise TypeError(f"no reshape from {array.shape} to {shape}")
    if (BATCH, *sizes) == array.shape:
        return array
    # 0 stands for "as it was".
    return Symbol("Reshape", (array, np.array([0, *sizes], np.int64)), (BATCH, *sizes), array.dtype)


def indexed(array: Symbol, index: tuple[Index, ...]) -> Symbol:
    """Take a part by numbers, slices, an ellipsis and new axes.

    Raises:
      TypeError: if the batch itself is to be cut, or the index is of another kind.
    """
    plain = sum(each is not None and each is not Ellipsis for each in index)
    if plain > array.ndim:
        raise TypeError(f"{plain} indices are too many for shape {array.shape}")
    place = next((at for at, each in enumerate(index) if each is Ellipsis), len(index))
    fill = (slice(None),) * (array.ndim - plain)
    parts = (*index[:place], *fill, *index[place + 1 :])
    array = _sliced(array, [each for each in parts if each is not None])
    axis = 0
    for each in parts:
        if isinstance(each, int):
            shape = (*array.shape[:axis], *array.shape[axis + 1 :])
            number, size = each, _size(array, axis)
            if not -size <= number < size:
                raise TypeError(f"index {number} is out of range for axis {axis} of shape {array.shape}")
            number %= size
            array = Symbol("Gather", (array, np.array(number, np.int64)), shape, array.dtype, "", (("axis", axis),))
        elif each is None:
            array = expanded(array, axis)
            axis += 1
        else:
            axis += 1
    return array


def expanded(array: Symbol, axis: int) -> Symbol:
    """Return an array with a new axis of size one."""
    shape = (*array.shape[:axis], 1, *array.shape[axis:])
    return Symbol("Unsqueeze", (array, np.array([axis], np.int64)), shape, array.dtype)


def _sliced(array: Symbol, parts: list[Any]) -> Symbol:
    cuts = []
    for axis, part in enumerate(parts):
        if not isinstance(part, int | slice) or isinstance(part, bool):
            raise TypeError(f"a symbolic array takes numbers and slices as indices, got {part!r}")
        if isinstance(part, slice) and part != slice(None):
            cuts.append((*part.indices(_size(array, axis)), axis))
    if not cuts:
        return array
    shape = list(array.shape)
    for start, stop, stride, axis in cuts:
        if stride != 1:
            raise TypeError(f"a symbolic array is cut without strides, got {stride}")
        shape[axis] = max(0, stop - start)
    starts, stops, _, axes = (np.array(each, np.int64) for each in zip(*cuts, strict=True))
    return Symbol("Slice", (array, starts, stops, axes), tuple(shape), array.dtype)


def _size(array: Symbol, axis: int) -> int:
    size = array.shape[axis]
    if not isinstance(size, int):
        raise TypeError(f"axis {axis} of shape {array.shape} is the batch, which can't be cut")
    return size


def in_order(outputs: Sequence[Symbol]) -> list[Symbol]:
    """Return everything that some symbols depend on, each once, in the order of computation."""
    found: dict[int, Symbol] = {}
    waiting = list(outputs)
    while waiting:
        each = waiting.pop()
        if each.serial not in found:
            found[each.serial] = each
            waiting.extend(one for one in each.inputs if isinstance(one, Symbol))
    return [found[serial] for serial in sorted(found)]
