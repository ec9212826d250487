"""A controller tried on a few engagements before it fights: what it returns, not what it hits."""

from typing import Any

import jax
import jax.numpy as jnp

from archerfish.dynamics.array_namespace import map_arrays
from archerfish.evaluation.suites import Trials
from archerfish.records.errors import InputError
from archerfish.sensing.interfaces import Command, Controller, Seen, World

_FEW = 5
"""Unlike the number of axes and coordinates, so that shapes can't be mistaken for each other."""
_SHAPES = Command(angle=(_FEW, 2), rate=(_FEW, 2), fire=(_FEW,), hit_probability=(_FEW,))


def rehearse(controller: Controller, world: World, trials: Trials) -> None:
    """Trace a controller through its first decision.

    Args:
      controller: of a user's own.
      world: where it will fight.
      trials: whom it will meet.

    Raises:
      InputError: if it returns something else than a controller must. What its own code raises is passed on.
    """
    few = map_arrays(lambda each: each[:_FEW], trials.engagements)
    draws = trials.draws[:_FEW]
    seen = jax.eval_shape(world.reset, few, draws)[1] if world.pure else world.reset(few, draws)[1]
    truth = world.truth(few) if getattr(controller, "needs_truth", False) else None
    controller = jax.tree.map(jnp.asarray, controller)
    state = jax.eval_shape(lambda each, seen: each.reset(seen, truth), controller, seen)
    after, command = jax.eval_shape(_step, controller, state, seen)
    for name, wanted, found in zip(Command._fields, _SHAPES, command, strict=True):
        if getattr(found, "shape", None) != wanted:
            told = getattr(found, "shape", type(found).__name__)
            raise InputError(f"step commands {name} of shape {told} for {_FEW} engagements, expected {wanted}")
    shapes, structures = (
        {_outline(each) for each in (after, state)},
        {jax.tree.structure(each) for each in (after, state)},
    )
    if len(shapes) + len(structures) > 2:
        raise InputError(
            f"step returns another state than reset: {_outline(after)} after {_outline(state)}, expected the same "
            "structure, shapes and types"
        )


def _step(controller: Controller, state: Any, seen: Seen) -> tuple[Any, Command]:
    answer: Any = controller.step(state, seen)
    if not isinstance(answer, tuple) or len(answer) != 2 or not isinstance(answer[1], Command):
        raise InputError(
            f"step returns {_kind(answer)}, expected (state, Command); fire_always(angle) of "
            "archerfish.sensing.interfaces makes one of angles"
        )
    return answer


def _kind(answer: Any) -> str:
    if hasattr(answer, "shape"):
        return "an array"
    if isinstance(answer, tuple) and not hasattr(answer, "_fields"):
        return f"({', '.join(type(each).__name__ for each in answer)})"
    return f"a {type(answer).__name__}"


def _outline(state: Any) -> str:
    return ", ".join(f"{each.dtype}{list(each.shape)}" for each in jax.tree.leaves(state)) or "nothing"
