"""One formula for NumPy and JAX: the namespace comes from the argument (Python array API standard)."""

from collections.abc import Callable
from typing import Any

import numpy as np

Array = Any
"""An array of NumPy or JAX. Shapes are in the docstrings; B stands for any batch shape, () included."""


def namespace(*arrays: Array) -> Any:
    """Return the array namespace of the arguments; plain Python numbers count as NumPy's.

    JAX wins over NumPy, so that constants built with NumPy may meet traced arrays.
    """
    found = {each.__array_namespace__() for each in arrays if hasattr(each, "__array_namespace__")}
    others = found - {np}
    return others.pop() if others else np


def lift(parameter: Array, array: Array) -> Array:
    """Give a parameter the rank of an array that it meets, by leading dimensions of one.

    Said instead of left to broadcasting, since a silent change of rank hides a wrong shape; JAX is told to refuse it.
    """
    return parameter.reshape((1,) * (array.ndim - parameter.ndim) + parameter.shape)


def map_arrays(function: Callable[..., Array], *trees: Any) -> Any:
    """Apply a function to the arrays of one or more equal trees of NamedTuples and tuples."""
    first = trees[0]
    if not isinstance(first, tuple):
        return function(*trees)
    parts = [map_arrays(function, *each) for each in zip(*trees, strict=True)]
    return type(first)(*parts) if hasattr(first, "_fields") else tuple(parts)


def single_precision(tree: Any) -> Any:
    """Return a tree of NumPy arrays with its floats as float32, built in float64 and run in float32."""

    def convert(array: Array) -> Array:
        array = np.asarray(array)
        return array.astype(np.float32) if array.dtype.kind == "f" else array

    return map_arrays(convert, tree)


def repeat(function: Callable[[Any], Any], count: int, state: Any) -> Any:
    """Apply a function to a tree of arrays a fixed number of times: a plain loop, or one compiled loop under JAX.

    Raises:
      TypeError: if the arrays are neither NumPy's nor JAX's.
    """
    arrays: list[Array] = []
    map_arrays(arrays.append, state)
    if namespace(*arrays) is np:
        for _ in range(count):
            state = function(state)
        return state
    _check_jax("repeat", *arrays)
    import jax  # only where the arrays are JAX's already: the robot has none

    return jax.lax.fori_loop(0, count, lambda _, each: function(each), state)


def if_any(condition: Array, then: Callable[[], Any], otherwise: Callable[[], Any]) -> Any:
    """Return one tree of arrays if any of a condition holds, else another.

    Under JAX, too, that one alone is computed, but both within `jax.vmap`.

    Args:
      condition: any shape.
      then: returns the one tree.
      otherwise: returns the other, of the same shapes.

    Raises:
      TypeError: if the condition is neither NumPy's nor JAX's.
    """
    if namespace(condition) is np:
        return then() if np.any(condition) else otherwise()
    _check_jax("if_any", condition)
    import jax  # only where the arrays are JAX's already: the robot has none

    return jax.lax.cond(condition.any(), then, otherwise)


def without_gradient(array: Array) -> Array:
    """Return an array of any shape as it is, through which no gradient goes back under JAX."""
    if not getattr(namespace(array), "__name__", "").startswith("jax"):
        return array
    import jax  # only where the array is JAX's already: the robot has none

    return jax.lax.stop_gradient(array)


def _check_jax(what: str, *arrays: Array) -> None:
    found = namespace(*arrays)
    if not getattr(found, "__name__", "").startswith("jax"):
        raise TypeError(f"{what} is of NumPy's arrays and JAX's, got those of {type(found).__name__}")
