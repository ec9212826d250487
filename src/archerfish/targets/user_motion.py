"""A user's motion: f(place B + (3,), speed B, uniforms B + (4,)) → an object with `position(time)`, or a `Target`.

A tree runs compiled. Any other object runs in NumPy, and its path is sampled when a target is drawn: a compiled program
calls back for that, and follows the path.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from archerfish.arrays import Array, is_tree, leaves, namespace
from archerfish.compiled import has_jax, import_jax
from archerfish.errors import InputError
from archerfish.plugins import Plugin, find_plugin
from archerfish.targets.motion import BEGIN_S, LONGEST_S, STEP_S, TIMES, Path, disc

UNIFORMS = 4
"""Uniform draws that a user's motion gets."""
_checked: dict[tuple[str, int, str], Plugin] = {}  # by name, identity and digest: an object may be changed
_FEW = 5  # unlike the number of coordinates, so that no shape is taken for another


def user_target(found: Plugin, place: Array, speed: Array, uniforms: Array) -> Any:
    """Draw a `Target` of a user's motion.

    Args:
      found: the motion.
      place: [m], shape B + (3,).
      speed: [m/s], shape B.
      uniforms: uniform draws, shape B + (UNIFORMS,).

    Raises:
      InputError: if the user's code fails.
    """
    with found.running():
        motion = found.value(place, speed, uniforms)
    return motion if hasattr(motion, "at") else disc(motion, place)


class _Sampled(NamedTuple):
    """A motion that runs in NumPy alone, as one of paths."""

    motion: Callable[..., Any]
    longest_s: float = LONGEST_S

    def __call__(self, place: Array, speed: Array, uniforms: Array) -> Path:
        sample = self._places
        if namespace(place) is not np:
            jax = import_jax()
            shape = jax.ShapeDtypeStruct((*speed.shape, len(TIMES), 3), place.dtype)
            sample = partial(jax.pure_callback, self._places, shape, vmap_method="sequential")
        return Path(sample(place, speed, uniforms), 0.0 * speed + BEGIN_S, 0.0 * speed + STEP_S)

    def _places(self, place: Array, speed: Array, uniforms: Array) -> Array:
        target = self.motion(*(np.asarray(drawn) for drawn in (place, speed, uniforms)))
        return np.stack([target.position(np.full_like(speed, time)) for time in TIMES], -2, dtype=place.dtype)


def find_motion(spec: Any) -> Plugin:
    """Find a user's motion, always the same object; at first it is checked, in NumPy and, where there is JAX, traced.

    Args:
      spec: ./FILE.py:NAME, MODULE:NAME, the name of an entry point, or the function.

    Raises:
      InputError: if it is not there, its code fails, what it returns is no motion, or it can't be compiled.
    """
    found = find_plugin(spec, "motion")
    if (key := (found.spec, id(found.value), found.digest)) not in _checked:
        _checked[key] = _check(found)
    return _checked[key]


def _check(found: Plugin) -> Plugin:
    """Return a motion, sampled if it is no tree; a few targets are drawn in NumPy, and traced where there is JAX."""

    def at(place: Array, speed: Array, uniforms: Array, time: Array) -> Any:
        return user_target(found, place, speed, uniforms).at(time)

    numbers, times = np.random.default_rng(0).random((_FEW, 4 + UNIFORMS), np.float32), np.zeros((2, _FEW), np.float32)
    drawn = (numbers[:, :3] + np.float32(1.0), numbers[:, 3], numbers[:, 4:])
    with found.running():
        motion = found.value(*drawn)
        kind, plates = type(motion).__name__, getattr(motion, "plates", 1)
        if not getattr(motion, "compiled", is_tree(motion)) and hasattr(motion, "position"):
            found = replace(found, value=_Sampled(found.value), ran=found.digest)
            motion = found.value(*drawn)
        if not is_tree(motion) or any(np.shape(each)[:1] != (_FEW,) for each in leaves(motion)):
            expected = "expected an object with position(time), each array as long as there are targets"
            raise InputError(f"returns a {kind}, {expected}; compute it from place, speed and uniforms")
        results = [at(*drawn, times)]
        if has_jax():
            results.append(import_jax().eval_shape(at, *drawn, times))
        expected = f"expected {(*times.shape, plates, 3)}: x, y, z of each plate"
        for position, normal_yaw in results:
            if (position.shape, normal_yaw.shape) != ((*times.shape, plates, 3), (*times.shape, plates)):
                raise InputError(f"{kind} has positions of shape {position.shape} at times {times.shape}, {expected}")
    return found
