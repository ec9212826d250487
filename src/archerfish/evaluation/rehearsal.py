"""A controller tried on a few engagements before it fights: what it returns, not what it hits."""

from typing import Any

import jax
import jax.numpy as jnp

from archerfish.controllers.own_decision import decide
from archerfish.dynamics.array_namespace import map_arrays
from archerfish.evaluation.suites import Trials
from archerfish.records.errors import InputError
from archerfish.sensing.interfaces import Controller, World

_FEW = 5
"""Unlike the number of axes and coordinates, so that shapes can't be mistaken for each other."""


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
    after, _ = jax.eval_shape(decide, controller, state, seen)
    shapes, structures = (
        {_outline(each) for each in (after, state)},
        {jax.tree.structure(each) for each in (after, state)},
    )
    if len(shapes) + len(structures) > 2:
        raise InputError(
            f"step returns another state than reset: {_outline(after)} after {_outline(state)}, expected the same "
            "structure, shapes and types"
        )


def _outline(state: Any) -> str:
    return ", ".join(f"{each.dtype}{list(each.shape)}" for each in jax.tree.leaves(state)) or "nothing"
