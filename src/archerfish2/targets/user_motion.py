"""A user's motion: f(place B + (3,), speed B, uniforms B + (4,)) → a tree with `position(time)`, or a `Target`."""

from typing import Any

import numpy as np

from archerfish2.arrays import Array, is_tree, leaves
from archerfish2.compiled import has_jax, import_jax
from archerfish2.errors import InputError
from archerfish2.plugins import Plugin, find_plugin
from archerfish2.targets.motion import disc

UNIFORMS = 4
"""Uniform draws that a user's motion gets."""
_checked: dict[tuple[str, int], Plugin] = {}  # by name and identity of the user's code, of which an edit makes another
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


def find_motion(spec: str) -> Plugin:
    """Find a user's motion, always the same object; at first it is checked, in NumPy and, where there is JAX, traced.

    Args:
      spec: ./FILE.py:NAME, MODULE:NAME, or the name of an entry point.

    Raises:
      InputError: if it is not there, its code fails, what it returns is no motion, or it can't be compiled.
    """
    found = find_plugin(spec, "motion")
    if (found.spec, id(found.value)) not in _checked:
        _check(found)
    return _checked.setdefault((found.spec, id(found.value)), found)


def _check(found: Plugin) -> None:
    """Draw a few targets in NumPy, and trace them as a compiled program does."""

    def at(place: Array, speed: Array, uniforms: Array, time: Array) -> Any:
        return user_target(found, place, speed, uniforms).at(time)

    numbers, times = np.random.default_rng(0).random((_FEW, 4 + UNIFORMS), np.float32), np.zeros((2, _FEW), np.float32)
    drawn = (numbers[:, :3] + np.float32(1.0), numbers[:, 3], numbers[:, 4:])
    with found.running():
        motion = found.value(*drawn)
        kind, plates = type(motion).__name__, getattr(motion, "plates", 1)
        if not is_tree(motion) or any(np.shape(each)[:1] != (_FEW,) for each in leaves(motion)):
            expected = "expected a NamedTuple with position(time), each array as long as there are targets"
            raise InputError(f"returns a {kind}, {expected}; compute it from place, speed and uniforms")
        results = [at(*drawn, times)]
        if has_jax():
            results.append(import_jax().eval_shape(at, *drawn, times))
        expected = f"expected {(*times.shape, plates, 3)}: x, y, z of each plate"
        for position, normal_yaw in results:
            if (position.shape, normal_yaw.shape) != ((*times.shape, plates, 3), (*times.shape, plates)):
                raise InputError(f"{kind} has positions of shape {position.shape} at times {times.shape}, {expected}")


def check_places(found: Plugin, target: Any, duration: Array) -> None:
    """Refuse targets that are nowhere, or not in front of the gimbal.

    Args:
      found: the user's motion.
      target: as drawn, of NumPy arrays.
      duration: of the engagements [s], shape B.

    Raises:
      InputError: naming where such a target is, and when.
    """
    times = duration * np.linspace(0.0, 1.0, 26, dtype=np.float32).reshape(-1, *(1,) * duration.ndim)
    with found.running():
        position = np.asarray(target.at(times).position)
    wrong = ~np.all(np.isfinite(position), axis=-1) | ~(position[..., 0] > 0.0)
    if np.any(wrong):
        at = f"{position[wrong][0].tolist()} m after {times[np.nonzero(wrong)[:-1]][0]:.2f} s"
        raise InputError(f"{found.spec}: a target is at {at}, expected numbers and x > 0; keep it before the gimbal")
