"""A model of another library as a controller."""

from typing import Any

import numpy as np

from archerfish.controllers.policy.observer import Observer
from archerfish.controllers.policy.policy import ObservingController
from archerfish.errors import InputError


class Player(ObservingController):
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

    def action(self, observation: Any) -> Any:
        """Return the action for an observation, shape (N, n) → (N, 2)."""
        action, _ = self.model.predict(self.normalise(observation), deterministic=True)
        return np.asarray(action, np.float32)
