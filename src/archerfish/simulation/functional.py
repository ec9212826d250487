"""One engagement as two pure functions of a random key: what libraries of reinforcement learning in JAX ask for.

The environment takes the place of their parameters: a NamedTuple of arrays, so it may be traced and mapped over too.
Many engagements side by side are `jax.vmap` of these; what has ended begins anew, as such libraries expect.
"""

from typing import NamedTuple

import jax
from jax import Array

from archerfish.dynamics.array_namespace import map_arrays
from archerfish.simulation.environment import EnvironmentState, ShootingEnvironment


class Timestep(NamedTuple):
    """What one step of one engagement gave; scalars but for the observations, or with a leading batch under vmap."""

    observation: Array
    """For the next decision, of the next engagement where this one ended, shape (n,)."""
    final_observation: Array
    """After this step, of this engagement: what the value of a truncated step is bootstrapped from, shape (n,)."""
    reward: Array
    """Eq (8), and the bonus of a hit [m], a scalar."""
    terminated: Array
    """Whether nothing can follow this step; never so in shooting, a scalar."""
    truncated: Array
    """Whether the engagement's time is up, a scalar."""
    miss: Array
    """Pellet minus armor in y and z [m], shape (2,)."""


def reset(key: Array, environment: ShootingEnvironment) -> tuple[EnvironmentState, Array]:
    """Begin one engagement.

    Args:
      key: PRNG key; is consumed.
      environment: where.

    Returns:
      State, and observation of shape (n,).
    """
    state, observation = environment.fresh(*_draws(key, environment))
    return map_arrays(_only, state), observation[0]


def step(
    state: EnvironmentState, action: Array, key: Array, environment: ShootingEnvironment
) -> tuple[EnvironmentState, Timestep]:
    """Advance one engagement by one decision, and begin another if it has ended.

    Args:
      state: of `reset` or of the step before.
      action: shape (2,); taken as it is, where the environments of Gymnasium clip theirs.
      key: PRNG key; is consumed.
      environment: where.
    """
    normals, uniforms = _draws(key, environment)
    batch = map_arrays(lambda each: each[None], state)
    going_on, given = environment.advance(batch, action[None], normals)
    following, observation = environment.renew(going_on, given, normals, uniforms)
    ended = given.truncated
    timestep = Timestep(observation, given.observation, given.reward, ended & False, ended, given.miss)
    return map_arrays(_only, following), map_arrays(_only, timestep)


def _draws(key: Array, environment: ShootingEnvironment) -> tuple[Array, Array]:
    first, second = jax.random.split(key)
    normals = jax.random.normal(first, (1, environment.normals))
    return normals, jax.random.uniform(second, (1, environment.uniforms))


def _only(batch: Array) -> Array:
    return batch[0]
