"""Traces: the package's own formulas run on arrays of scalar symbols and leave a list of elementary operations.

An array of symbols is a NumPy array of objects with a namespace of its own, so indexing, stacking and broadcasting are
NumPy's. Equal scalars are one symbol. A loop of a fixed number of rounds stays a loop, a product with a large constant
matrix a product, and a network a network; all else becomes operations on scalars in float32, which `c99` and `onnx`
print.
"""

import functools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from archerfish.arrays import TracedNamespace, leaves, map_arrays

_BOOLEAN = "less less_equal greater greater_equal equal not_equal logical_and logical_or logical_not"
_NUMERIC = "add subtract multiply divide negative absolute sign floor round maximum minimum where"
_FUNCTIONS = "sqrt sin cos tanh exp log expm1 log1p arctan2"
OPERATIONS = f"{_BOOLEAN} {_NUMERIC} {_FUNCTIONS}".split()
"""All operations on scalars, by the names of NumPy's functions; the first ones give what is true or false."""
_OTHER_NAMES = {"bitwise_and": "logical_and", "bitwise_or": "logical_or", "invert": "logical_not", "rint": "round"}
_NEUTRAL = {"add": 0.0, "subtract": 0.0, "multiply": 1.0, "divide": 1.0}


class Symbol:
    """A scalar: an operation on symbols and numbers, an input, or what a loop or a network gives."""

    def __init__(self, trace: "Trace", operation: str, arguments: tuple[Any, ...], is_bool: bool) -> None:
        """Make a symbol of a trace, with the next number; `loops` are those in whose rounds it changes."""
        self.trace, self.operation, self.arguments, self.is_bool = trace, operation, arguments, is_bool
        own = arguments[:1] if operation in ("carried", "item") else ()
        self.number, self.loops = len(trace.made), frozenset(own) or loops_of(self)

    def __bool__(self) -> bool:
        """Refuse: a formula must not branch on what is known only when it runs."""
        raise TypeError("a formula asks for the truth of a symbol; it needs where or select instead")


@dataclass(eq=False)
class Loop:
    """Rounds of the same operations: values are carried along, each round has items of its own, and gives results."""

    begin: list[Any]  # carried values at first
    items: list[list[Any]]  # of each round
    after: Sequence[Any] = ()  # what a round leaves in the carried values
    given: Sequence[Any] = ()  # results of a round


@dataclass(eq=False)
class Network:
    """Fully connected layers with ReLU between them; one alone, with a bias of zero, is a product with a matrix."""

    vector: list[Any]  # n scalars
    layers: list[tuple[Any, ...]]  # float32 weights and biases, (n, m) and (m,)


def symbols_of(values: Iterable[Any]) -> list[Symbol]:
    """Return those of some scalars that are no numbers."""
    return [each for each in values if isinstance(each, Symbol)]


def loops_of(whole: Any) -> frozenset[Any]:
    """Return the loops in whose rounds the parts of something change; there is no loop inside another one."""
    parts = (each for each in parts_of(whole) if not isinstance(each, Loop))
    return frozenset().union(*(each.loops if isinstance(each, Symbol) else loops_of(each) for each in parts))


def parts_of(whole: Any) -> list[Any]:
    """Return what a symbol, a loop or a network is made of."""
    if isinstance(whole, Symbol):
        return [each for each in whole.arguments if isinstance(each, Symbol | Loop | Network)]
    if isinstance(whole, Network):
        return symbols_of(whole.vector)
    return symbols_of((*whole.begin, *(each for row in whole.items for each in row), *whole.after, *whole.given))


class Trace:
    """Symbols in the order in which they were made, so that each comes after what it is made of."""

    def __init__(self) -> None:
        """Begin without any."""
        self.made: dict[Any, Symbol] = {}

    def symbol(self, operation: str, *arguments: Any, is_bool: bool = False) -> Symbol:
        """Return the symbol of an operation; the one that there is, if there is one."""
        key = (operation, *(repr(each) if isinstance(each, bool | np.generic) else each for each in arguments))
        if key not in self.made:
            self.made[key] = Symbol(self, operation, arguments, is_bool)
        return self.made[key]

    def like(self, tree: Any, operation: str, *of: Any) -> Any:
        """Return a tree of new symbols in the shapes of another one, numbered through all its arrays."""
        new = iter([self.symbol(operation, *of, at, is_bool=_is_bool(s)) for at, s in enumerate(scalars_of(tree))])
        return map_arrays(lambda array: traced([next(new) for _ in range(np.size(array))], np.shape(array)), tree)


def scalars_of(tree: Any) -> list[Any]:
    """Return the scalars of a tree's arrays, symbols and numbers, in order."""
    return [scalar for array in leaves(tree) for scalar in np.asarray(array, object).reshape(-1)]


def traced(scalars: Sequence[Any], shape: tuple[int, ...]) -> "Traced":
    """Return scalars as an array."""
    array = np.empty(len(scalars), object)
    array[:] = scalars
    return array.reshape(shape).view(Traced)


def _is_bool(value: Any) -> bool:
    return value.is_bool if isinstance(value, Symbol) else isinstance(value, bool | np.bool_)


def _number(value: Any) -> Any:
    """Return a scalar as a number, also if it is true or false."""
    if isinstance(value, Symbol):
        return _where(value, 1.0, 0.0) if value.is_bool else value
    return np.float32(value)


@functools.cache
def _operation(name: str) -> Callable[..., Any]:
    """Return an operation on scalars: of numbers a number, else a symbol, or an argument that it leaves as it is."""
    name = _OTHER_NAMES.get(name, name)
    if name in ("power", "square"):
        return _power
    if name == "clip":
        return lambda value, low, high: _operation("minimum")(_operation("maximum")(value, low), high)
    if name not in OPERATIONS:
        raise TypeError(f"{name} can't be traced, only {', '.join(sorted(OPERATIONS))}")

    def apply(*given: Any) -> Any:
        arguments = given if name.startswith("logical") else tuple(map(_number, given))
        if not (symbols := symbols_of(arguments)):
            return getattr(np, name)(*arguments)[()]
        # No product with zero is left out: of infinity it is not zero.
        if name in _NEUTRAL and arguments[1] == _NEUTRAL[name]:
            return arguments[0]
        if name in ("add", "multiply") and arguments[0] == _NEUTRAL[name]:
            return arguments[1]
        return symbols[0].trace.symbol(name, *arguments, is_bool=name in _BOOLEAN.split())

    return apply


def _power(value: Any, exponent: Any = 2) -> Any:
    if exponent not in (1, 2, 3, 4):
        raise TypeError(f"a power of {exponent} can't be traced, only 1 to 4")
    return functools.reduce(_operation("multiply"), [value] * int(exponent))


def _where(condition: Any, one: Any, other: Any) -> Any:
    if not isinstance(condition, Symbol):
        return one if condition else other
    is_bool = _is_bool(one) and _is_bool(other)
    one, other = (each if is_bool else _number(each) for each in (one, other))
    return one if one is other else condition.trace.symbol("where", condition, one, other, is_bool=is_bool)


def _each(function: Callable[..., Any], *arrays: Any) -> Any:
    """Apply a function of scalars to arrays that are broadcast against each other."""
    plain = [np.asarray(each).view(np.ndarray) for each in arrays]
    return np.asarray(np.frompyfunc(function, len(plain), 1)(*plain), object).view(Traced)


def _reduced(function: Callable[..., Any], array: Any, axis: Any = 0, keepdims: bool = False, **_: Any) -> Any:
    axes = tuple(each % array.ndim for each in np.atleast_1d(range(array.ndim) if axis is None else axis))
    rows = np.moveaxis(array, axes, range(len(axes))).reshape(-1, *np.delete(array.shape, axes))
    found = functools.reduce(functools.partial(_each, function), rows)
    return np.expand_dims(found, axes) if keepdims else found


def _matrix_product(one: Any, other: Any) -> Any:
    if not isinstance(other, Traced) and other.ndim == 2 and other.size >= 64:  # else it becomes scalars
        return _NAMESPACE.network([(other, np.zeros(other.shape[1]))], one)
    if other.ndim == 1:
        return (one * other).sum(axis=-1)
    return (one[..., None] * (other[..., None, :, :] if one.ndim > 1 else other)).sum(axis=-2)


class Traced(np.ndarray[Any, Any]):
    """An array of symbols and numbers."""

    def __array_namespace__(self, **_: Any) -> Any:
        """Return the namespace of traced arrays."""
        return _NAMESPACE

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        """Apply one of NumPy's universal functions to each scalar, or along axes."""
        if ufunc is np.matmul:
            return _matrix_product(*inputs)
        whole = method in ("__call__", "reduce") and options.get("where", True) is True and "initial" not in options
        function = _operation(ufunc.__name__ if whole else f"{ufunc.__name__}.{method} with such options")
        return _each(function, *inputs) if method == "__call__" else _reduced(function, *inputs, **options)

    def __array_function__(self, function: Any, types: Any, arguments: Any, options: Any) -> Any:
        """Let one of NumPy's functions run, and return what it gives as a traced array."""
        found = super().__array_function__(function, types, arguments, options)
        return found.view(Traced) if isinstance(found, np.ndarray) and found.dtype == object else found

    def __getitem__(self, key: Any) -> Any:
        """Return a part, an array also if it is a single scalar."""
        return np.asarray(super().__getitem__(key), object).view(Traced)

    def __iter__(self) -> Any:
        """Yield rows, arrays also where they are single scalars."""
        return (self[at] for at in range(len(self)))


class _Namespace:
    """NumPy's functions for traced arrays; `network`, `fold` and `over` are what stays whole."""

    __name__ = "traced"
    asarray = staticmethod(np.asanyarray)
    where = staticmethod(functools.partial(_each, _where))
    round = staticmethod(functools.partial(_each, _operation("round")))

    def __getattr__(self, name: str) -> Any:
        return getattr(np, name)

    def network(self, layers: Any, array: Any) -> Any:
        """Apply fully connected layers to each vector of an array."""
        layers, found = [tuple(np.asarray(each, np.float32) for each in layer) for layer in layers], list[Any]()
        for row in np.asarray(array, object).reshape(-1, array.shape[-1]):
            whole = Network(list(row), layers)
            found += [symbols_of(row)[0].trace.symbol("element", whole, at) for at in range(len(layers[-1][1]))]
        return traced(found, (*array.shape[:-1], -1))

    def fold(self, function: Any, items: list[Any], state: Any) -> Any:
        """Apply state = function(state, item) for each of the items, if there are several in a loop."""
        looped = _loop if len(items) > 1 else lambda body, before, items: body(before, items[0])
        return looped(lambda carried, item: (function(carried, item), ()), state, items)[0]

    def over(self, function: Any, array: Any) -> Any:
        """Apply a function to one row of an array after the other, in a loop."""
        rows = [array[at : at + 1] for at in range(len(array))]
        return np.concatenate(_loop(lambda _, row: ((), function(row)), (), rows)[1])


_NAMESPACE: TracedNamespace = _Namespace()


def _loop(function: Any, state: Any, items: list[Any]) -> tuple[Any, list[Any]]:
    """Trace (state, item) → (state, given) once, as the body of a loop; return the last state and what each gave."""
    trace = symbols_of(scalars_of((state, *items)))[0].trace
    loop = Loop(scalars_of(state), [scalars_of(each) for each in items])
    after, given = function(trace.like(state, "carried", loop), trace.like(items[0], "item", loop))
    loop.after, loop.given = scalars_of(after), scalars_of(given)
    if loops_of(loop) - {loop}:
        raise TypeError("a loop inside a loop can't be traced")
    return trace.like(state, "result", loop), [trace.like(given, "given", loop, at) for at in range(len(items))]


def schedule(outputs: Iterable[Any]) -> list[Any]:
    """Return what outputs need, each after what it is made of.

    Returns:
      Symbols, networks, and pairs of a loop and the schedule of its body.
    """
    needed, waiting = set[Any](), symbols_of(outputs)
    while waiting:
        if (each := waiting.pop()) not in needed:
            needed.add(each)
            waiting += parts_of(each)
    steps, placed = dict[Any, list[Any]]({None: []}), set[Any]()
    for symbol in sorted(symbols_of(needed), key=lambda each: each.number):
        into, whole = steps.setdefault(next(iter(symbol.loops), None), []), symbol.arguments[0]
        if symbol.operation in ("result", "given", "element") and whole not in placed:
            placed.add(whole)
            into.append((whole, steps.setdefault(whole, [])) if isinstance(whole, Loop) else whole)
        into.append(symbol)
    return steps[None]
