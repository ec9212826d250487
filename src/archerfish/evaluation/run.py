"""Any controller in any world: one compiled program, or a loop in which each of the two is compiled if it can be.

Without JAX everything runs in NumPy. Worlds and controllers are arguments of the programs, so another one of the same
shapes compiles nothing.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.arrays import Array, is_tree, map_arrays, namespace
from archerfish.compiled import has_jax, import_jax
from archerfish.dynamics.aiming import intercept
from archerfish.errors import InputError
from archerfish.plugins import find_plugin
from archerfish.protocols import Command, Controller, Engagement, Seen, Shot, World

LARGEST = 2048
"""Engagements that run at once."""
Advance = Callable[[int], None]
"""Gets how many engagements are done."""


class Counted(NamedTuple):
    """What counting takes of the decisions of N engagements."""

    fired: NDArray[np.bool_]  # (N, T)
    hit: NDArray[np.bool_]  # (N, T)
    yaw_acceleration: float | None  # largest mean over a period of command and motion [rad/s²]; None of perfect aim


def count(
    world: World, controller: Controller, engagement: Engagement, normals: Array, progress: Advance = lambda _: None
) -> Counted:
    """Let a controller shoot and return which decisions fired and which hit.

    Many engagements run in equal parts of at most `LARGEST`, so that memory doesn't grow with their number.

    Args:
      world: where.
      controller: any.
      engagement: N of them.
      normals: standard normals of all decisions, shape (N, T, world.normals).
      progress: gets how many engagements are done.

    Raises:
      InputError: if a command is not finite.
    """
    number = len(normals)
    size = -(-number // -(-number // LARGEST))
    if size < number:
        fired, hit, largest = list[Any](), list[Any](), 0.0
        for start in range(0, number, size):
            # The last part begins earlier, so that all are of one shape, which is compiled once.
            first = min(start, number - size)
            part = map_arrays(lambda values, first=first: values[first : first + size], engagement)
            counted = count(world, controller, part, normals[first : first + size])
            fired.append(counted.fired[start - first :])
            hit.append(counted.hit[start - first :])
            largest = max(largest, counted.yaw_acceleration or 0.0)
            progress(first + size)
        return Counted(np.concatenate(fired), np.concatenate(hit), largest)
    if is_compiled(world) and is_compiled(controller):
        by_decision, hits, bend, finite = _run("count", world, controller, engagement, normals)
        if finite:
            return Counted(by_decision.T, hits.T, float(bend) / world.period_s**2)
    seen, _, in_force, shot = decisions(world, controller, engagement, normals)
    _check_finite(type(controller).__name__, in_force)
    yaw = np.stack([in_force[..., 1].T, shot.angle[..., 1].T], axis=1)
    bend = _largest_bend(yaw, map_arrays(lambda values: values[:, 0], seen))
    return Counted(shot.fired, shot.fired & (shot.margin >= 0.0), float(bend) / world.period_s**2)


def decisions(
    world: World, controller: Controller, engagement: Engagement, normals: Array, *, may_compile: bool = True
) -> Any:
    """Let a controller shoot and return what was seen, commanded, in force and shot at all decisions, B + (T, ...).

    Args:
      world: where.
      controller: any.
      engagement: of any batch shape B.
      normals: standard normals of all decisions, shape B + (T, world.normals).
      may_compile: whether JAX may be used where it is there.

    Raises:
      InputError: if a command is not finite, where one of the two is not compiled.
    """
    axis = normals.ndim - 2
    if may_compile and is_compiled(world) and is_compiled(controller):
        in_force, (seen, command, shot) = _run("rollout", world, controller, engagement, normals)
        return map_arrays(lambda values: np.moveaxis(values, 0, axis), (seen, command, in_force, shot))
    method: Any = _method if may_compile else getattr
    begin, see, step = (method(world, name) for name in ("begin", "see", "step"))
    reset, decide = (method(controller, name) for name in ("reset", "step"))
    state = begin(engagement, normals)
    truth = world.truth(engagement) if getattr(controller, "needs_truth", False) else None
    seen = map_arrays(np.array, see(state))  # copies: PyTorch takes no arrays that are read-only, as JAX's are
    memory, decided = reset(seen, truth), []
    deciding, shooting = find_plugin(controller, "controller"), find_plugin(world, "world")
    for place in range(normals.shape[axis]):
        with deciding.running():
            memory, command = decide(memory, seen)
            command = map_arrays(np.asarray, command)
        _check_finite(type(controller).__name__, command.angle.reshape(-1, 1, 2), place)
        with shooting.running():
            state, shot = step(state, command, normals[..., place, :])
            after = map_arrays(np.array, see(state))
        decided.append((seen, command, after.command, map_arrays(np.asarray, shot)))
        seen = after
    return map_arrays(lambda *values: np.stack(values, axis=axis), *decided)


def count_perfect_aim(world: Any, engagement: Engagement, normals: Array) -> Counted:
    """Score perfect aim: the gimbal is at the intercept's angles at every shot, so the dispersion alone is left.

    Args:
      world: a simulator, with `shoot`.
      engagement: N of them.
      normals: standard normals of all decisions, shape (N, T, world.normals).
    """
    hit = _run("perfect", world, engagement, normals) if is_compiled(world) else _perfect(world, engagement, normals)
    return Counted(np.ones_like(hit.T), np.asarray(hit).T, None)


def is_compiled(value: Any) -> bool:
    """Whether a world or controller runs in compiled programs."""
    return has_jax() and bool(getattr(value, "compiled", is_tree(value)))


def _perfect(world: Any, engagement: Engagement, normals: Array) -> Array:
    """Return hits of all decisions at once, (T, N)."""
    drawn = np.moveaxis(normals, 1, 0) if isinstance(normals, np.ndarray) else normals.swapaxes(0, 1)
    times = np.arange(1, len(drawn) + 1, dtype=np.float32)[:, None] * world.period + 0.0 * engagement.duration[None]
    muzzle = world.muzzle_of(engagement)
    if muzzle.speed.ndim:
        muzzle = map_arrays(lambda values: values[None], muzzle)
    angle = intercept(lambda time: engagement.target.at(time).position[..., 0, :], times, muzzle).angle
    return world.shoot(engagement, times, angle, 0.0 * angle, times > 0.0, drawn).margin >= 0.0


def _run(name: str, *arguments: Any) -> Any:
    jax = import_jax()
    return jax.tree.map(np.asarray, _programs()[name](*jax.tree.map(jax.numpy.asarray, arguments)))


def _method(value: Any, name: str) -> Callable[..., Any]:
    if not is_compiled(value):
        function: Callable[..., Any] = getattr(value, name)
        return function
    return functools.partial(_programs()[name], import_jax().tree.map(import_jax().numpy.asarray, value))


@functools.cache
def _programs() -> dict[str, Any]:
    """Return the compiled programs by name."""
    jax = import_jax()
    names = ("begin", "see", "reset", "step")
    methods = {name: jax.jit(lambda value, *rest, name=name: getattr(value, name)(*rest)) for name in names}
    return {**methods, "count": jax.jit(_count), "rollout": jax.jit(_scan), "perfect": jax.jit(_perfect)}


def _scan(
    world: World, controller: Controller, engagement: Engagement, normals: Array, keep: Any = lambda *decision: decision
) -> tuple[Array, Any]:
    """Return the commands in force and what `keep` takes of (seen, command, shot), decisions first."""
    jax = import_jax()
    state = world.begin(engagement, normals)
    truth = world.truth(engagement) if getattr(controller, "needs_truth", False) else None
    memory = controller.reset(world.see(state), truth)

    def step(carry: Any, place: Array) -> Any:
        state, memory = carry
        # Seen here, not carried: what a world lacks (a base that moves, an age) is a constant to the compiler.
        seen = world.see(state)
        memory, command = controller.step(memory, seen)
        drawn = jax.lax.dynamic_index_in_dim(normals, place, -2, keepdims=False)
        state, shot = world.step(state, command, drawn)
        return (state, memory), (seen.command, keep(seen, command, shot))

    # Never unrolled: two decisions in one iteration run at 1.6 times the cost.
    places = jax.numpy.arange(normals.shape[-2])
    (state, _), (before, kept) = jax.lax.scan(step, (state, memory), places)
    return jax.numpy.concat([before[1:], world.see(state).command[None]]), kept


def _count(world: World, controller: Controller, engagement: Engagement, normals: Array) -> tuple[Array, ...]:
    xp = import_jax().numpy

    def keep(seen: Seen, command: Command, shot: Shot) -> tuple[Array, ...]:  # noqa: ARG001
        return shot.fired, shot.fired & (shot.margin >= 0.0), shot.angle[..., 1]

    in_force, (fired, hit, yaw) = _scan(world, controller, engagement, normals, keep)
    bend = _largest_bend(xp.stack([in_force[..., 1], yaw], axis=1), world.see(world.begin(engagement, normals)))
    return fired, hit, bend, xp.isfinite(in_force).all()


def _largest_bend(yaw: Array, first: Seen) -> Array:
    """Return the largest second difference of yaw command and yaw, (T, 2, N), from the rest seen first [rad]."""
    xp = namespace(yaw)
    rest = xp.stack([first.command[..., 1], first.gimbal.angle[..., 1]])[None]
    from_rest = xp.concat([rest, rest, yaw], axis=0)
    return xp.max(xp.abs(xp.diff(from_rest, n=2, axis=0)))


def _check_finite(name: str, angles: NDArray[np.float32], before: int = 0) -> None:
    """Refuse commands that no gimbal can follow, (N, T, 2), so many decisions after the first."""
    wrong = np.argwhere(~np.isfinite(angles))
    if len(wrong):
        engagement, decision, axis = wrong[0]
        command = f"commands a {('pitch', 'yaw')[axis]} of {angles[engagement, decision, axis]} rad"
        place = f"at decision {before + decision + 1}, in {len(np.unique(wrong[:, 0]))} of {len(angles)} engagements"
        remedy = "expected finite angles; guard divisions and roots in its step"
        raise InputError(f"{name}: {command} {place}, {remedy}")
