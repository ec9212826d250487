"""Target motions of a user's own, in the place of eq (7): how one is found, drawn and checked."""

import functools
import importlib.util
from collections.abc import Callable, Hashable
from typing import Any, NamedTuple

import numpy as np

from archerfish.dynamics.array_namespace import Array, map_arrays
from archerfish.records.errors import InputError
from archerfish.records.extensions import Extension, find_extension, own_code
from archerfish.targets.motion import TargetMotion

CHANCES = 4
"""Uniform draws that a motion of a user's own is given."""
_FEW = 5
"""Unlike the number of coordinates, so that shapes can't be mistaken for each other."""


class _Empty(NamedTuple):
    """No arrays."""


class OwnMotion(NamedTuple):
    """A kind of motion that engagements can be drawn from."""

    name: str
    """By which results call it."""
    drawer: Any
    """For `Scenario.motion`: an empty NamedTuple with a function `draw`, so that a compiled program can be given it."""
    extension: Extension
    """Where it comes from."""


def find_motion(spec: str) -> OwnMotion:
    """Find a target motion of a user's own.

    Args:
      spec: ./FILE.py:NAME, MODULE:NAME, or the name of an entry point of the group `archerfish.motions`; a function
        draw(place, speed, chance) that returns a motion, or a class with such a function, `draw`.

    Raises:
      InputError: if it can't be found, its code fails, what it draws is no motion, or, where JAX is installed, it can't
        be compiled.
    """
    found = find_extension(spec, "motion")
    draw = getattr(found.value, "draw", None) if isinstance(found.value, type) else found.value
    if not callable(draw) or not isinstance(draw, Hashable):
        raise InputError(
            f"{found.where}: expected a function draw(place, speed, chance) that returns a motion, or a class with "
            f"such a classmethod, got {type(found.value).__name__} {found.name}; docs/adding.md has one"
        )
    drawer = _drawer(draw, found)
    _rehearse(drawer, found)
    return OwnMotion(found.name, drawer, found)


@functools.cache
def _drawer(draw: Callable[..., Any], extension: Extension) -> Any:
    """Make the empty NamedTuple; always the same one of a function, so that nothing is compiled twice."""

    def drawn(place: Array, speed: Array, chance: Array) -> TargetMotion:
        with own_code(extension):
            motion: TargetMotion = draw(place, speed, chance)
            _check_record(motion, place.shape[:-1])
        return motion

    return type("Drawer", (_Empty,), {"draw": staticmethod(drawn), "chances": CHANCES})()


def _check_record(motion: Any, batch: tuple[int, ...]) -> None:
    if not getattr(motion, "_fields", ()) or not callable(getattr(motion, "position", None)):
        raise InputError(f"draws a {type(motion).__name__}, expected a NamedTuple of arrays with position(time)")
    for name, value in zip(motion._fields, motion, strict=True):
        shapes: list[Any] = []
        map_arrays(lambda each, shapes=shapes: shapes.append(getattr(each, "shape", None)), value)
        for shape in shapes:
            if shape is None or shape[: len(batch)] != batch:
                found = "no array" if shape is None else f"of shape {shape}"
                raise InputError(
                    f"{type(motion).__name__}.{name} is {found}, expected an array whose shape begins with that of "
                    f"the engagements, here {batch}; compute it from what draw is given"
                )


def _rehearse(drawer: Any, extension: Extension) -> None:
    """Draw a few in NumPy, and, where JAX is installed, trace them as a compiled program does."""

    def path(place: Array, speed: Array, chance: Array, time: Array) -> Array:
        return drawer.draw(place, speed, chance).position(time)

    numbers = np.random.default_rng(0).random((_FEW, CHANCES + 4)).astype(np.float32)
    places = np.stack([1.0 + 4.0 * numbers[:, 0], numbers[:, 1] - 0.5, 0.0 * numbers[:, 2]], axis=-1)
    arguments = (places, numbers[:, 3], numbers[:, 4:], np.zeros(_FEW, np.float32))
    with own_code(extension):
        shapes: list[Any] = [np.shape(path(*arguments))]
        if importlib.util.find_spec("jax") is not None:
            import jax  # a page of trials needs none

            shapes.append(getattr(jax.eval_shape(path, *arguments), "shape", None))
        for shape in shapes:
            if shape != (_FEW, 3):
                raise InputError(
                    f"position(time) returns shape {shape} for {_FEW} targets, expected ({_FEW}, 3): x, y, z of each"
                )


def check_paths(motion: OwnMotion, targets: TargetMotion, seconds: float) -> None:
    """Refuse targets that are nowhere, or not in front of the gimbal.

    Args:
      motion: for the message.
      targets: as drawn for an evaluation, shape (B,).
      seconds: length of an engagement [s].

    Raises:
      InputError: naming where such a target is, and when.
    """
    for time in np.linspace(0.0, seconds, 26, dtype=np.float32):
        with own_code(motion.extension):
            place = np.asarray(targets.position(np.full(_count(targets), time)))
            wrong = ~np.all(np.isfinite(place), axis=-1) | ~(place[..., 0] > 0.0)
            if np.any(wrong):
                told = ", ".join(f"{each:.3g}" for each in place[wrong][0])
                raise InputError(
                    f"a target is at ({told}) m after {time:.2f} s, expected numbers, and x > 0: before the gimbal"
                )


def _count(targets: Any) -> int:
    counts: list[int] = []
    map_arrays(lambda each: counts.append(len(each)), targets)
    return counts[0]
