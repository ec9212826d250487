"""The analytic policy gradient: the reward's own slope, where PPO estimates one from trials.

The simulator is differentiable, so the mean reward of a short window of decisions is a function of the policy's weights
like any other: the window is played, and the gradient goes back through all its steps of environment and network. Adam
or Muon follows it. The states continue from window to window, the gradient does not.

It sees nothing of what jumps, such as a hit that is not smoothed, nor of what comes of a window's decisions after its
end.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import optax
from jax import Array

from archerfish.controllers.policy.network import normalise
from archerfish.learning import learner as learners
from archerfish.learning.environment import Environment
from archerfish.learning.learner import Actor, Learner, Metrics, Trainer, magnitude, optimiser_step, updated
from archerfish.learning.shards import averaged, own_key

LEAST_RATE = 0.05
"""Share of the learning rate that annealing leaves: less than PPO's, for the last milliradians need small steps."""


def _iteration(
    environment: Environment, settings: dict[str, Array], learner: Learner, sizes: dict[str, Any]
) -> tuple[Learner, Metrics, Metrics]:
    key, noise = jax.random.split(learner.key)
    keys = jax.random.split(own_key(noise))
    # Columns: to draw a few numbers in a row, many times, takes several times as long.
    normals = jax.random.normal(keys[0], (sizes["window"], environment.normals, sizes["environments"]))
    fresh = learners.fresh_engagements(environment, keys[1], sizes["environments"])
    slope = jax.grad(window_loss, has_aux=True)
    gradient, (state, observation, observations, actions, rewards, hits) = slope(
        learner.actor, environment, learner, normals, fresh, settings["engagement_norm"]
    )
    gradient, mean_reward, hit_share = averaged((gradient, jnp.mean(rewards), jnp.mean(hits)))
    norm = optax.tree.norm(gradient)
    rate = settings["learning_rate"] * jnp.maximum(1.0 - learner.iteration / settings["anneal_over"], LEAST_RATE)
    before, largest = (learner.actor, gradient, learner.moments[0]), settings["gradient_norm"]
    actor, moments = optimiser_step(sizes["optimiser"], *before, rate, largest)
    after = learner._replace(
        actor=actor,
        moments=(moments, learner.moments[1]),
        # The statistics change between iterations only, and no gradient goes through them.
        normaliser=updated(learner.normaliser, observations),
        environment=state,
        observation=observation,
        key=key,
        iteration=learner.iteration + 1,
    )
    watched = {"observation": magnitude(observations, observation), "action": magnitude(actions)}
    watched |= {"reward": magnitude(rewards), "gradient": norm}
    return after, {"mean_reward": mean_reward, "hit_share": hit_share, "gradient_norm": norm}, watched


GRADIENT = Trainer(
    _iteration,
    scalars=("learning_rate", "gradient_norm", "engagement_norm"),
    sizes=("environments", "window", "shards", "optimiser"),
    draws=False,
)
"""The analytic policy gradient."""


def window_loss(
    actor: Actor, environment: Environment, learner: Learner, normals: Array, fresh: Any, engagement_norm: Array
) -> tuple[Array, tuple[Any, ...]]:
    """Play a window and return the negative of its mean reward, to be differentiated by the actor.

    Args:
      actor: the policy; acts as its mean.
      environment: where.
      learner: with the normaliser, and the environments before the window.
      normals: standard normals, shape (W, normals, B).
      fresh: engagements that replace those that end.
      engagement_norm: see `GradientConfig`.

    Returns:
      The loss; state of the environments and observation (B, n) after it, observations (W, B, n), actions (W, B, 2),
      rewards (W, B) and hits (W, B).
    """
    # The loss is a mean: each reward has this share in it.
    limit = jnp.asarray(engagement_norm / normals.shape[0] / len(learner.observation))

    def decide(carry: tuple[Any, Array], drawn: Array) -> tuple[tuple[Any, Array], tuple[Array, ...]]:
        state, observation = carry
        action = actor.mean(clip_cotangent(normalise(learner.normaliser, observation), limit))
        state, step = environment.step(state, action, drawn.T, fresh)
        hit = jnp.float32(step.shot.fired & (step.shot.margin >= 0.0))
        return (state, step.observation), (observation, action, step.reward, hit)

    start = (learner.environment, learner.observation)
    (state, observation), played = jax.lax.scan(decide, start, normals)
    return -jnp.mean(played[2]), (state, observation, *played)


@partial(jax.custom_vjp)
def clip_cotangent(rows: Array, limit: Array) -> Array:  # noqa: ARG001 (for the gradient)
    """Return rows, shape (B, n), as they are, but scale the gradient of each to at most a norm, shape ().

    Where a gimbal is only commanded what it can follow, a small change of an observation may grow from decision to
    decision, and so does the gradient on its way back: by orders of magnitude in a few ill-conditioned engagements,
    which then dominate all others. To scale the sum, as is done with the whole gradient, is too late for those.
    """
    return rows


def _clip(limit: Array, gradient: Array) -> tuple[Array, Array]:
    norm = jnp.sqrt(jnp.sum(gradient**2, axis=-1, keepdims=True))
    return gradient * jnp.where(norm > limit, limit / norm, 1.0), jnp.zeros_like(limit)


clip_cotangent.defvjp(lambda rows, limit: (rows, limit), _clip)
