"""One formula for NumPy, JAX and traced scalars, and trees of arrays that work with JAX and without it.

The namespace comes from the argument (Python array API standard). A tree is a NamedTuple, a tuple, or a dataclass made
by `tree`. Nothing here loads JAX but for arrays that are its own. A class that was made before JAX was loaded is
registered with it by the next `single_precision`, through which every world, environment and controller passes, and by
every verb that compiles.
"""

import dataclasses
import functools
import sys
from collections.abc import Callable
from typing import Any, Protocol, TypeVar, cast, dataclass_transform

import numpy as np
from numpy.typing import NDArray

from archerfish.errors import InputError

Array = Any
"""An array of NumPy or JAX. Shapes are in the docstrings; B stands for any batch shape, () included."""


def real_array(name: str, values: Any) -> NDArray[np.float64]:
    """Return a copy of what was given as numbers.

    Raises:
      InputError: if it is none.
    """
    try:
        return np.array(values, np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name}: expected an array of numbers, got {ascii(values)[:60]}; correct it") from error


class TracedNamespace(Protocol):
    """What a namespace of traced scalars has beside NumPy's functions: what stays whole in a printed program."""

    def network(self, layers: Any, array: Array) -> Array:
        """Apply fully connected layers, pairs of weights and biases, to each vector of an array, shape B + (n,)."""

    def fold(self, function: Callable[[Any, Any], Any], items: list[Any], state: Any) -> Any:
        """Return the last of state = function(state, item), a loop if there are several items."""

    def over(self, function: Callable[[Array], Array], array: Array) -> Array:
        """Return function(array), of which row by row depends on the same row alone, as a loop; shape (n, ...)."""


def namespace(*arrays: Array) -> Any:
    """Return the array namespace of the arguments; plain Python numbers count as NumPy's.

    Any other namespace wins over NumPy's, so that constants built with NumPy combine with traced arrays.
    """
    for each in arrays:
        if type(each) is not np.ndarray and not isinstance(each, np.generic) and hasattr(each, "__array_namespace__"):
            return each.__array_namespace__()
    return np


def lift(parameter: Array, array: Array) -> Array:
    """Give a parameter the rank of an array that it is combined with, by leading dimensions of one.

    Explicit instead of left to broadcasting: a silent change of rank hides a wrong shape, and JAX is set to refuse it.
    """
    return parameter.reshape((1,) * (array.ndim - parameter.ndim) + parameter.shape)


T = TypeVar("T")  # a tree of arrays
_parts: dict[type, tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]] = {}  # data, static, left out
_pending: list[type] = []  # not registered with JAX yet


@dataclass_transform(frozen_default=True, eq_default=False)
def tree(static: tuple[str, ...] = (), left_out: tuple[str, ...] = ()) -> Callable[[type], Any]:
    """Make a class a frozen dataclass whose other fields are trees of arrays.

    JAX builds instances of tracers and placeholders: no checks in `__post_init__`.

    Args:
      static: names of hashable fields; a program is compiled for each value.
      left_out: names of fields with a default, which is what programs see.

    Raises:
      TypeError: if a name is no field, or a field that is left out has no default.
    """

    def decorate(cls: type) -> Any:
        made: Any = dataclasses.dataclass(frozen=True, eq=False)(cls)  # arrays have no ==; hashed by identity
        fields = {each.name: each for each in dataclasses.fields(made)}
        wrong = [name for name in (*static, *left_out) if name not in fields]
        wrong += [name for name in left_out if name in fields and fields[name].default is dataclasses.MISSING]
        if wrong:
            raise TypeError(f"{cls.__name__}: {', '.join(wrong)} must be fields, with a default if left out")
        _parts[made] = (tuple(name for name in fields if name not in (*static, *left_out)), static, left_out)
        _pending.append(made)
        register()
        return made

    return decorate


def register() -> None:
    """Register with JAX, if it is loaded, the classes that `tree` made."""
    if sys.modules.get("jax") is not None:  # None: blocked
        from jax.tree_util import register_dataclass

        while _pending:
            cls = _pending.pop()
            register_dataclass(cls, *_parts[cls])


def is_tree(value: Any) -> bool:
    """Whether a value is a NamedTuple or of a class that `tree` made."""
    return type(value) in _parts or hasattr(type(value), "_fields")


def map_arrays(function: Callable[..., Any], *trees: Any) -> Any:
    """Apply a function to the arrays of equal trees; None is skipped, static and left-out fields are the first's.

    Raises:
      ValueError: if the trees differ.
    """
    first = trees[0]
    if first is None:
        if any(each is not None for each in trees):
            raise ValueError("trees differ: None in one, an array in another")
        return None
    if type(first) in _parts:
        names = _parts[type(first)][0]
        mapped = {name: map_arrays(function, *(getattr(each, name) for each in trees)) for name in names}
        return dataclasses.replace(first, **mapped)
    if not isinstance(first, tuple):
        return function(*trees)
    parts = [map_arrays(function, *each) for each in zip(*trees, strict=True)]
    return type(first)(*parts) if hasattr(first, "_fields") else tuple(parts)


def leaves(value: Any) -> list[Array]:
    """Return the arrays of a tree, in order."""
    found: list[Array] = []
    map_arrays(found.append, value)
    return found


def single_precision(value: T) -> T:
    """Return a tree with its floats as NumPy's float32; Python numbers become arrays."""
    register()

    def convert(array: Array) -> Array:
        array = np.asarray(array)
        return array.astype(np.float32) if array.dtype.kind == "f" else array

    return cast(T, map_arrays(convert, value))


def select(condition: Array, one: T, other: T) -> T:
    """Choose between equal trees per member of a batch.

    Args:
      condition: shape B.
      one: arrays of shape B + (...), taken where the condition holds.
      other: the same shapes.
    """
    xp = namespace(condition)
    if xp is np and condition.ndim == 0:
        return one if condition else other

    def choose(a: Array, b: Array) -> Array:
        return xp.where(xp.reshape(condition, condition.shape + (1,) * (a.ndim - condition.ndim)), a, b)

    return cast(T, map_arrays(choose, one, other))


def when_any(condition: Array, function: Callable[[T, T], T], new: T, old: T) -> T:
    """Return function(new, old) if a condition, shape B, holds anywhere, else `old`, a tree of the same shapes.

    A compiled program doesn't run the function where the condition holds nowhere.
    """
    if _is_jax(condition):
        import jax

        return cast(T, jax.lax.cond(jax.numpy.any(condition), function, lambda _, other: other, new, old))
    return function(new, old) if condition.any() else old


def fold(function: Callable[[T, Any], T], state: T, items: Any, axis: int) -> T:
    """Apply state = function(state, item) along an axis: a Python loop, under JAX one compiled loop.

    Args:
      function: (state, item) → state of the same shapes.
      state: a tree of arrays.
      items: a tree of arrays of one length along the axis; an item lacks that axis.
      axis: index of the axis, the same in all arrays.
    """
    arrays = leaves(items)
    count = arrays[0].shape[axis]
    if count > 1 and _is_jax(*arrays):
        import jax

        moved = map_arrays(lambda each: jax.numpy.moveaxis(each, axis, 0), items)
        return jax.lax.scan(lambda before, item: (function(before, item), None), state, moved)[0]
    before = (slice(None),) * axis
    rounds = [map_arrays(lambda each, at=(*before, place): each[at], items) for place in range(count)]
    return cast(T, getattr(namespace(*arrays), "fold", functools.reduce)(function, rounds, state))


def repeat(function: Callable[[T], T], count: int, state: T) -> T:
    """Apply a function to a tree of arrays a fixed number of times: a Python loop, under JAX one compiled loop."""
    if _is_jax(*leaves(state)):
        import jax

        return jax.lax.fori_loop(0, count, lambda _, each: function(each), state)  # type: ignore[no-any-return]
    fold = getattr(namespace(*leaves(state)), "fold", functools.reduce)
    return cast(T, fold(lambda before, _: function(before), [()] * count, state))


def over(function: Callable[[Array], Array], array: Array) -> Array:
    """Return function(array), of which row by row depends on the same row alone; traced scalars in a loop over them."""
    return getattr(namespace(array), "over", lambda *_: function(array))(function, array)


def without_gradient(array: Array) -> Array:
    """Return an array of any shape as it is, through which no gradient goes back under JAX."""
    if not _is_jax(array):
        return array
    import jax

    return jax.lax.stop_gradient(array)


def _is_jax(*arrays: Array) -> bool:
    return getattr(namespace(*arrays), "__name__", "").startswith("jax")
