"""What --vary says: a parameter with the values to try, or with a range to sample from."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from archerfish.cli.sweeping.parameters import Parameter, Value, find_parameter
from archerfish.records.errors import InputError


@dataclass(frozen=True)
class Values:
    """Values to try."""

    name: str
    """Parameter."""
    values: tuple[Value, ...]
    """At least one, none twice."""


@dataclass(frozen=True)
class Range:
    """A range to sample from, its ends included."""

    name: str
    """Parameter."""
    low: float
    """Lower end, a whole number for a parameter of whole numbers."""
    high: float
    """Upper end."""
    log: bool
    """Whether to sample the logarithm evenly."""
    whole: bool
    """Whether only whole numbers count."""


Axis = Values | Range


def parse_vary(words: Sequence[str]) -> tuple[Axis, ...]:
    """Read what --vary was given: NAME=A,B,… or NAME=LOW..HIGH or NAME=LOW..HIGH:log each.

    Raises:
      InputError: if a parameter is unknown or given twice, or a value is not one of it.
    """
    axes = tuple(_parse(word) for word in words)
    names = [axis.name for axis in axes]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"--vary gives {name} twice; give all of its values at once")
    return axes


def _parse(word: str) -> Axis:
    name, equals, said = word.partition("=")
    if not equals:
        raise InputError(f"--vary: expected NAME=VALUES, got {word!r}; say for instance ppo.clip=0.1,0.2")
    parameter = find_parameter(name)
    if ".." in said and parameter.kind in (int, float):
        return _range(parameter, said)
    values = tuple(_value(parameter, each.strip()) for each in said.split(","))
    if len(set(values)) < len(values):
        raise InputError(f"--vary {parameter.name}={said}: a value is given twice")
    return Values(parameter.name, values)


def _range(parameter: Parameter, said: str) -> Range:
    ends, colon, scale = said.partition(":")
    if colon and scale != "log":
        raise InputError(f'--vary {parameter.name}={said}: expected LOW..HIGH or LOW..HIGH:log, got ":{scale}"')
    if parameter.world:
        raise InputError(
            f"--vary {parameter.name}={said}: changes what is shot at, so a sampler would pick the easiest; "
            "list the values, each configuration is tried with all of them"
        )
    low, high = (_number(parameter, each.strip()) for each in ends.split("..", 1))
    if not low < high:
        raise InputError(f"--vary {parameter.name}={said}: the lower end must lie below the upper one")
    if colon and low <= 0:
        raise InputError(f"--vary {parameter.name}={said}: a logarithmic range must begin above 0")
    return Range(parameter.name, low, high, bool(colon), parameter.kind is int)


def _number(parameter: Parameter, said: str) -> float:
    value = _value(parameter, said)
    assert not isinstance(value, str)
    return value


def _value(parameter: Parameter, said: str) -> Value:
    words = {bool: "true or false", int: "a whole number", float: "a finite number", str: "a word"}
    problem = InputError(f"--vary {parameter.name}: expected {words[parameter.kind]}, got {said!r}")
    if parameter.kind is bool:
        if said.lower() not in ("true", "false"):
            raise problem
        return said.lower() == "true"
    if parameter.choices and said not in parameter.choices:
        raise InputError(f"--vary {parameter.name}: expected one of {', '.join(parameter.choices)}, got {said!r}")
    try:
        value: Value = parameter.kind(said)
    except ValueError:
        raise problem from None
    if value == "" or (isinstance(value, float) and not math.isfinite(value)):
        raise problem
    if parameter.positive and not isinstance(value, str) and value <= 0:
        raise InputError(f"--vary {parameter.name}: expected a number > 0, got {said!r}")
    return value


def grid(axes: Sequence[Axis]) -> list[dict[str, Value]]:
    """Return every combination of the values of axes, the last axis changing fastest; of none, one that is empty.

    Raises:
      InputError: if an axis is a range.
    """
    for axis in axes:
        if isinstance(axis, Range):
            raise InputError(
                f"--vary {axis.name}: a range needs --trials, the number of trials to sample; or list values: "
                f"{axis.name}={axis.low:g},{axis.high:g}"
            )
    listed = [axis.values for axis in axes if isinstance(axis, Values)]
    return [dict(zip([axis.name for axis in axes], values, strict=True)) for values in itertools.product(*listed)]


def corners(axes: Sequence[Axis]) -> list[dict[str, Value]]:
    """Return combinations that hold every value and both ends of every range at least once, for a check."""
    ends = [axis.values if isinstance(axis, Values) else (axis.low, axis.high) for axis in axes]
    count = max((len(each) for each in ends), default=1)
    names = [axis.name for axis in axes]
    return [dict(zip(names, (each[index % len(each)] for each in ends), strict=True)) for index in range(count)]


def told(values: Mapping[str, Value]) -> str:
    """Write a combination in a few words."""
    return " ".join(f"{name}={short(value)}" for name, value in values.items()) or "as given"


def short(value: Value) -> str:
    """Write a value with as many digits as a table needs."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.4g}" if isinstance(value, float) else str(value)
