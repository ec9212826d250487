"""Generalised advantage estimation, with termination and truncation kept apart."""

import jax
import jax.numpy as jnp
from jax import Array


def advantages(
    rewards: Array,
    values: Array,
    next_values: Array,
    terminated: Array,
    truncated: Array,
    discount: Array | float,
    trace: Array | float,
) -> Array:
    """Estimate the advantage A of eq (9) by an exponentially weighted sum of temporal differences.

        δ_t = r_t + γ (1 − terminated_t) V(s'_t) − V(s_t),    A_t = δ_t + γ λ (1 − ended_t) A_{t+1}

    s'_t is the state that follows within the same episode, so a truncated step bootstraps from the final observation,
    never from the first one of the next episode; a terminated step bootstraps from nothing. Both cut the trace.

    Args:
      rewards: shape (T, B).
      values: V(s_t), shape (T, B).
      next_values: V(s'_t), shape (T, B).
      terminated: shape (T, B).
      truncated: shape (T, B).
      discount: γ.
      trace: λ.

    Returns:
      Advantages, shape (T, B).
    """
    delta = rewards + discount * jnp.where(terminated, 0.0, next_values) - values
    carried = discount * trace * jnp.where(terminated | truncated, 0.0, 1.0)

    def backwards(following: Array, step: tuple[Array, Array]) -> tuple[Array, Array]:
        current = step[0] + step[1] * following
        return current, current

    _, result = jax.lax.scan(backwards, jnp.zeros_like(delta[0]), (delta, carried), reverse=True)
    return result
