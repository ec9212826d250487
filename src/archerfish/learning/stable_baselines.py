"""Many engagements side by side for Stable-Baselines3, whose vector environments are not Gymnasium's.

Its package is no dependency: only importing this module needs it. Its models play in evaluations as `player.Player`.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from archerfish.errors import InputError
from archerfish.learning.gymnasium import Floats, ShootingVectorEnv
from archerfish.simulation.picture import Picture

try:
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as error:
    raise InputError("this needs Stable-Baselines3, which is not installed; pip install stable-baselines3") from error


class ShootingVecEnv(VecEnv):  # type: ignore[misc]  # its package may be missing
    """Engagements side by side, as Stable-Baselines3 has them."""

    def __init__(self, num_envs: int = 1, *arguments: Any, **options: Any) -> None:
        """Make environments; arguments as of `ShootingVectorEnv`."""
        self.inner = ShootingVectorEnv(num_envs, *arguments, **options)
        self.render_mode = self.inner.render_mode
        super().__init__(num_envs, self.inner.single_observation_space, self.inner.single_action_space)
        self.metadata = self.inner.metadata

    def reset(self) -> Floats:
        """Begin all engagements, with the seeds of `seed` if they are new, shape (B, n)."""
        seeds = None if all(each is None for each in self._seeds) else [*self._seeds]
        observation, _ = self.inner.reset(seed=seeds, options=next((each for each in self._options if each), None))
        self._reset_seeds()
        self._reset_options()
        return observation

    def step_async(self, actions: Floats) -> None:
        """Take the actions of the next step, shape (B, 2)."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, ...]:
        """Take the step: observations (B, n), rewards [m], whether engagements ended, and an info for each."""
        observation, reward, _, ended, more = self.inner.step(self._actions)
        infos: list[dict[str, Any]] = [
            {"TimeLimit.truncated": up, "miss": miss, "hit": hit}
            for up, miss, hit in zip(ended.tolist(), more["miss"], more["hit"].tolist(), strict=True)
        ]
        for member in np.flatnonzero(ended):
            infos[member]["terminal_observation"] = more["final_obs"][member]
        return observation, reward, ended, infos

    def get_images(self) -> Sequence[Picture]:
        """Draw every engagement, each of shape (height, width, 3)."""
        return self.inner.render() or ()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute, which all environments share."""
        return [getattr(self.inner, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:  # noqa: ARG002
        """Refuse: the environments run as one."""
        raise InputError(f"{attr_name} can't be set on environments that run as one; make them with it")

    def env_method(self, method_name: str, *_: Any, **__: Any) -> list[Any]:
        """Refuse: there is no single environment to call."""
        raise InputError(f"{method_name} can't be called on environments that run as one; call it on each of your own")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:  # noqa: ARG002
        """Return that none is wrapped."""
        return [False] * len(list(self._get_indices(indices)))

    def close(self) -> None:
        """Close nothing: there are no processes and no windows."""
