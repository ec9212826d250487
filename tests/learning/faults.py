"""An environment that goes bad at a chosen moment, and gradient steps that do."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from archerfish.learning import ppo, update
from archerfish.simulation.environment import Outcome


class Faulty(NamedTuple):
    """An environment whose first engagement has a bad observation or reward from a step on, counted over the whole
    training; all others are of another shard, or good."""

    inner: Any
    bad_observation: Array
    """Step from which an observation has a bad number."""
    bad_reward: Array
    """Step from which a reward is bad."""
    value: Array
    """The bad number."""

    @property
    def observed(self) -> int:
        return int(self.inner.observed)

    @property
    def normals(self) -> int:
        return int(self.inner.normals)

    @property
    def uniforms(self) -> int:
        return int(self.inner.uniforms)

    def begin(self, normals: Array, uniforms: Array) -> tuple[Any, Array]:
        state, observation = self.inner.begin(normals, uniforms)
        never = jnp.full(normals.shape[0], -(10**9))
        return (state, never.at[0].set(0)), observation

    def step(self, state: Any, action: Array, normals: Array, uniforms: Array) -> tuple[Any, Outcome]:
        inner, step = state
        inner, outcome = self.inner.step(inner, action, normals, uniforms)
        reward = jnp.where(step >= self.bad_reward, self.value, outcome.reward)
        spoilt = jnp.where((step >= self.bad_observation)[:, None], self.value, outcome.observation)
        return (inner, step + 1), outcome._replace(observation=spoilt, reward=reward)


def faulty(inner: Any, *, observation: int = 10**6, reward: int = 10**6, value: float = jnp.nan) -> Faulty:
    """Return an environment that goes bad at a step."""
    return Faulty(inner, jnp.int32(observation), jnp.int32(reward), jnp.float32(value))


def spoil_updates(monkeypatch: Any, what: str, after: int) -> None:
    """Have gradient steps make NaN of the gradient, the log_std or the weights once `after` of them are done."""
    real = update.update

    def spoilt(settings: Any, networks: Any, batch: Any, rate: Any, axis: Any) -> Any:
        nan = jnp.where(networks.actor_moments.count >= after, jnp.nan, 0.0)
        if what == "gradient":
            # An advantage of NaN gives a gradient of NaN.
            return real(settings, networks, batch._replace(advantage=batch.advantage + nan), rate, axis)
        changed, measures = real(settings, networks, batch, rate, axis)
        actor = changed.actor
        if what == "log_std":
            return changed._replace(actor=actor._replace(log_std=actor.log_std + nan)), measures
        return changed._replace(critic=jax.tree.map(lambda each: each + nan, changed.critic)), measures

    monkeypatch.setattr(ppo, "update", spoilt)
    # What was compiled before knows nothing of it, and what is compiled now must not stay.
    jax.clear_caches()
