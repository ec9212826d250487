"""Engagements fought: any controller in any world, every decision scored."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from archerfish.dynamics.array_namespace import Array, map_arrays
from archerfish.dynamics.intercept import intercept
from archerfish.dynamics.muzzle import DRAWS as MUZZLE_DRAWS
from archerfish.dynamics.muzzle import pellet_at_muzzle
from archerfish.evaluation.suites import Trials
from archerfish.records.errors import InputError
from archerfish.sensing.interfaces import Command, Controller, Engagement, Seen, Truth, World
from archerfish.simulation.environment import PureWorld
from archerfish.simulation.shooting import miss_at_armor


class Shots(NamedTuple):
    """What became of every decision of every engagement, shape (engagements, T) first."""

    fired: NDArray[np.bool_]
    """Whether a pellet left the muzzle, shape (...)."""
    miss: NDArray[np.float32]
    """Pellet minus armor in y and z [m], NaN without a pellet, shape (..., 2)."""
    command: NDArray[np.float32]
    """Pitch and yaw command after the limits [rad], shape (..., 2)."""
    angle: NDArray[np.float32]
    """Pitch and yaw of the gimbal at the end of each decision's period [rad], shape (..., 2)."""

    fallback: NDArray[np.bool_]
    """Whether the controller fell back on a simpler one, shape (...)."""

    def hits(self, radius: float) -> NDArray[np.bool_]:
        """Whether each decision hit: a pellet was fired, with a miss distance of at most `radius` [m]."""
        return np.asarray(self.fired & (np.linalg.norm(self.miss, axis=-1) <= radius))


_DECIDED_TOGETHER = range(64, 257)
"""Engagements that a controller decides for at once where the world is stepped, if such a number divides them all: the
state of a filter with many hypotheses then stays in the processor's cache. One size, since each is compiled."""


def fight(world: World, controller: Controller, trials: Trials) -> Shots:
    """Let a controller fight engagements.

    Args:
      world: a pure one is compiled into one program, any other one is stepped.
      controller: its fields are arguments of that program, so another of the same shapes compiles nothing.
      trials: whom to meet, and the draws.
    """
    if world.pure:
        arguments = jax.tree.map(jnp.asarray, (world, controller, trials.engagements, trials.draws))
        return Shots(*(np.moveaxis(np.asarray(each), 0, 1) for each in _fight_compiled(*arguments)))
    return _fight_stepping(world, controller, trials)


@jax.jit
def _fight_compiled(world: World, controller: Controller, engagements: Engagement, draws: Array) -> Shots:
    shooting, seen = world.reset(engagements, draws)
    state = controller.reset(seen, _truth(world, controller, engagements))

    def step(carry: tuple[Any, Any, Any], _: None) -> tuple[tuple[Any, Any, Any], Shots]:
        shooting, seen, state = carry
        state, command = controller.step(state, seen)
        shooting, seen, shot = world.step(shooting, command)
        return (shooting, seen, state), Shots(shot.fired, shot.miss, seen.command, shot.angle, command.fallback)

    _, shots = jax.lax.scan(step, (shooting, seen, state), length=draws.shape[-2])
    return shots


def _fight_stepping(world: World, controller: Controller, trials: Trials) -> Shots:
    # The world can't be compiled, but the controller can: in NumPy its programmes would take most of the time.
    decider = jax.tree.map(jnp.asarray, controller)
    count = len(trials.draws)
    size = max((each for each in _DECIDED_TOGETHER if count % each == 0), default=count)
    shooting, seen = world.reset(trials.engagements, trials.draws)
    truths = (_truth(world, controller, few) for few in _split(trials.engagements, size))
    states = [_reset_compiled(decider, *each) for each in zip(_split(seen, size), truths, strict=True)]
    shots = []
    for _ in range(trials.draws.shape[-2]):
        decided = [_step_compiled(decider, *each) for each in zip(states, _split(seen, size), strict=True)]
        states = [state for state, _ in decided]
        command = map_arrays(lambda *parts: np.concatenate(parts), *(command for _, command in decided))
        check_finite(type(controller).__name__, command.angle[:, None])
        shooting, seen, shot = world.step(shooting, command)
        miss, commanded, angle = (np.asarray(each, np.float32) for each in (shot.miss, seen.command, shot.angle))
        shots.append(Shots(np.asarray(shot.fired), miss, commanded, angle, np.asarray(command.fallback)))
    return Shots(*(np.stack(each, axis=1) for each in zip(*shots, strict=True)))


def _split(tree: Any, size: int) -> list[Any]:
    """Cut arrays of engagements into parts of a size, shape (n, ...) each."""
    arrays: list[Array] = []
    map_arrays(arrays.append, tree)
    return [
        map_arrays(lambda each, start=start: each[start : start + size], tree)
        for start in range(0, len(arrays[0]), size)
    ]


@jax.jit
def _reset_compiled(controller: Controller, seen: Seen, truth: Truth | None) -> Any:
    return controller.reset(seen, truth)


@jax.jit
def _step_compiled(controller: Controller, state: Any, seen: Seen) -> tuple[Any, Command]:
    return controller.step(state, seen)


def check_finite(name: str, angles: NDArray[np.float32]) -> None:
    """Refuse commands that no gimbal can follow.

    Args:
      name: of the controller.
      angles: pitch and yaw [rad], shape (engagements, T, 2).

    Raises:
      InputError: if one is not finite.
    """
    wrong = np.argwhere(~np.isfinite(angles))
    if len(wrong):
        engagement, decision, axis = wrong[0]
        value, count = angles[engagement, decision, axis], len(np.unique(wrong[:, 0]))
        raise InputError(
            f"{name}: commands a {('pitch', 'yaw')[axis]} of {value} rad at decision {decision + 1}, in {count} of "
            f"{len(angles)} engagements, expected finite angles; guard divisions and roots in its step"
        )


def _truth(world: World, controller: Controller, engagements: Engagement) -> Truth | None:
    """Return the truth for a controller that declares `needs_truth`, as the oracle does, and nothing for any other."""
    return world.truth(engagements) if getattr(controller, "needs_truth", False) else None


def perfect_shots(world: PureWorld, trials: Trials) -> Shots:
    """Score perfect aim, which fires at every decision: what the dispersion alone leaves, whatever moves the gimbal.

    The gimbal is put at the intercept's angles for every shot, at rest.
    """
    arguments = jax.tree.map(jnp.asarray, (world, trials.engagements, trials.draws))
    return Shots(*(np.asarray(each) for each in _perfect_compiled(*arguments)))


@jax.jit
def _perfect_compiled(world: PureWorld, engagements: Engagement, draws: Array) -> tuple[Array, ...]:
    steps = draws.shape[-2]
    motion = map_arrays(lambda each: each[:, None], engagements.motion)
    fired = (jnp.arange(1, steps + 1) * world.period)[None, :] + jnp.zeros((draws.shape[0], 1))
    aim = intercept(motion.position, fired, world.muzzle).angle
    position, velocity = pellet_at_muzzle(world.muzzle, aim, jnp.zeros_like(aim), draws[..., :MUZZLE_DRAWS])
    miss, _ = miss_at_armor(world.muzzle, motion, fired, position, velocity)
    every = jnp.ones(fired.shape, bool)
    return every, miss, aim, aim, ~every


def largest_acceleration(angles: NDArray[np.float32], period_s: float, axis: int) -> float:
    """Largest mean acceleration over a period that the gimbal was asked [rad/s²], from rest at zero.

    Args:
      angles: commands or gimbal angles, shape (engagements, T, 2).
      period_s: decision period [s].
      axis: 0 pitch, 1 yaw.
    """
    from_rest = np.pad(angles[..., axis], ((0, 0), (2, 0)))  # engagements begin at rest at zero
    second = np.diff(from_rest, n=2, axis=1)
    return float(np.max(np.abs(second)) / period_s**2)
