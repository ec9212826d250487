"""A model of another library as a controller."""

from typing import Any

import numpy as np

from archerfish2.controllers.policy.observer import Memory, Observer
from archerfish2.errors import InputError
from archerfish2.protocols import Command, Seen, Truth


class Player:
    """A controller from anything with `predict(observation, deterministic=True)`, for `evaluate` and `rollout`."""

    compiled = False

    def __init__(self, model: Any, observer: Observer, normalise: Any = None) -> None:
        """Take a model.

        Args:
          model: of Stable-Baselines3, or anything else with `predict`.
          observer: of the environment that it was trained in: `environment.observer`, `env.unwrapped.observer`.
          normalise: what was done to observations, as `VecNormalize.normalize_obs`; nothing if not given.

        Raises:
          InputError: if `observer` is none.
        """
        if not isinstance(observer, Observer):
            raise InputError(f"observer: expected that of an environment, got a {type(observer).__name__}; give it")
        self.model, self.observer = model, observer
        self.normalise = normalise or (lambda observation: observation)

    def reset(self, seen: Seen, truth: Truth | None = None) -> Memory:  # noqa: ARG002
        """Return the memory at the beginning of an engagement."""
        return self.observer.begin(seen)

    def step(self, state: Memory, seen: Seen) -> tuple[Memory, Command]:
        """Decide."""
        memory = self.observer.remember(state, seen)
        view = self.observer.view(memory, seen)
        action, _ = self.model.predict(self.normalise(self.observer.observe(view)), deterministic=True)
        return memory, self.observer.decode(view, np.asarray(action, np.float32))
