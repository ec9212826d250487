"""What may go wrong in an iteration, found inside the compiled program: a learner is kept as it was before.

A number is bad if it is not finite, or so large that it soon will not be. The comparison `|x| <= limit` fails for NaN
as well, so that one pass over an array finds all three.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax import Array

from archerfish.learning.config import MAX_LOG_STD

Learner = TypeVar("Learner")

WATCHED = ("observation", "action", "reward", "gradient", "log_std", "weights", "statistics")
"""What is looked at, in the order of cause and effect; the code of a fault is the place in this list, from 1."""
LIMITS = {
    "observation": 1e8,
    "action": 1e8,
    "reward": 1e8,
    "gradient": 1e12,
    "log_std": MAX_LOG_STD,
    "weights": 1e6,
}
"""Largest magnitude of each that training goes on with: far beyond any that learns."""


def is_bad(array: Array, limit: float = jnp.inf) -> Array:
    """Tell whether any number of an array is not finite or beyond a limit, any shape → ()."""
    magnitude = jnp.abs(array)
    return jnp.any(~(magnitude <= limit) | ~jnp.isfinite(magnitude))


def first_fault(bad: Array, names: tuple[str, ...]) -> Array:
    """Return the code of the first fault, 0 for none.

    Args:
      bad: in the order in which things happened, shape (T, n).
      names: of `WATCHED`, n of them.
    """
    codes = jnp.array([WATCHED.index(name) + 1 for name in names], jnp.int32)
    flat = bad.reshape(-1)
    return jnp.where(jnp.any(flat), codes[jnp.argmax(flat) % len(names)], 0)


def rollout_fault(observation: Array, action: Array, reward: Array, final: Array, following: Array) -> Array:
    """Return the code of the first fault of a rollout, 0 for none.

    Args:
      observation: before each decision, shape (T, B, n).
      action: shape (T, B, m).
      reward: shape (T, B).
      final: observation after each decision, shape (T, B, n).
      following: observation of the decision that comes after the rollout, shape (B, n).
    """

    def each(array: Array, name: str) -> Array:
        return jax.vmap(lambda row: is_bad(row, LIMITS[name]))(array)

    names = ("observation", "action", "reward")
    seen = first_fault(
        jnp.stack([each(a, n) for a, n in zip((observation, action, reward), names, strict=True)], 1), names
    )
    after = is_bad(final, LIMITS["observation"]) | is_bad(following, LIMITS["observation"])
    return jnp.where(seen == 0, after.astype(jnp.int32), seen)


def any_bad(tree: Any, limit: float = jnp.inf) -> Array:
    """Tell whether any number with a fraction in a tree of arrays is bad, any shapes → ()."""
    leaves = [each for each in jax.tree.leaves(tree) if jnp.issubdtype(each.dtype, jnp.inexact)]
    return jnp.any(jnp.stack([is_bad(each, limit) for each in leaves])) if leaves else jnp.bool_(False)


def guarded(iteration: Callable[[Learner], tuple[Learner, Any]]) -> Callable[[Learner, None], tuple[Learner, Any]]:
    """Make an iteration the body of a scan that keeps the learner of before the first bad iteration.

    The iterations after a bad one begin where it began, and so are bad in the same way: nothing has to remember it.

    Args:
      iteration: learner → learner, metrics; metrics have a `fault`, 0 or the code of what the iteration found itself.
        The learner's `networks` and `normaliser` are looked at here.
    """

    def body(learner: Learner, _: None) -> tuple[Learner, Any]:
        advanced, metrics = iteration(learner)
        tree: Any = advanced
        bad = jnp.stack([any_bad(tree.networks, LIMITS["weights"]), any_bad(tree.normaliser)])[None, :]
        fault = jnp.where(metrics.fault == 0, first_fault(bad, ("weights", "statistics")), metrics.fault)
        kept = jax.tree.map(lambda new, old: jax.lax.select(fault == 0, new, old), advanced, learner)
        return kept, metrics._replace(fault=fault)

    return body
