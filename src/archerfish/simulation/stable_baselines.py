"""Many engagements side by side for Stable-Baselines3, which takes no vector environment of Gymnasium's.

Its package is no dependency of ours: only importing this module needs it.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archerfish.records.errors import InputError
from archerfish.simulation.gymnasium_env import Floats, check_reset
from archerfish.simulation.picture import Picture
from archerfish.simulation.vector_env import ShootingVectorEnv

try:
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as error:
    raise InputError(
        "the environment for Stable-Baselines3 needs its package; install it: pip install stable-baselines3"
    ) from error


class ShootingVecEnv(VecEnv):  # type: ignore[misc]  # its package may be missing
    """Engagements side by side, as Stable-Baselines3 wants them."""

    def __init__(self, num_envs: int = 1, **options: Any) -> None:
        """Make the environments.

        Args:
          num_envs: B engagements.
          options: of `ShootingVectorEnv`.

        Raises:
          InputError: if an option can't be used.
        """
        self._inner = ShootingVectorEnv(num_envs, **options)
        self.render_mode = self._inner.render_mode
        super().__init__(num_envs, self._inner.single_observation_space, self._inner.single_action_space)
        self.metadata = self._inner.metadata  # its own would lose the rate of the frames
        self._actions: Floats | None = None

    def reset(self) -> Floats:
        """Begin all engagements, with the seeds of `seed` if they are new, shape (B, n).

        Raises:
          InputError: if there are options; none are known.
        """
        for each in self._options:
            check_reset(None, each)
        # Stable-Baselines3 gives None for an environment that it has no seed for.
        seeds = None if all(each is None for each in self._seeds) else [*self._seeds]
        observation, _ = self._inner.reset(seed=seeds)
        self._reset_seeds()
        self._reset_options()
        return observation

    def step_async(self, actions: Floats) -> None:
        """Take the actions of the next step, shape (B, 2)."""
        self._actions = actions

    def step_wait(self) -> tuple[Floats, Floats, NDArray[np.bool_], list[dict[str, Any]]]:
        """Take the step: observations, rewards [m], whether engagements ended, and an info for each.

        An info has `miss`, where the pellet passed the armor in y and z [m], and `hit`, besides what its package wants.
        """
        assert self._actions is not None
        observation, given = self._inner.advance(self._actions)
        ended = np.array(given.truncated)
        miss, hit = self._inner.passed(given)
        infos: list[dict[str, Any]] = [
            {"TimeLimit.truncated": up, "miss": where, "hit": struck}
            for up, where, struck in zip(ended.tolist(), miss, hit.tolist(), strict=True)
        ]
        if ended.any():
            final = np.asarray(given.observation)
            for member in np.flatnonzero(ended):
                infos[member]["terminal_observation"] = final[member].copy()
        return np.array(observation), np.array(given.reward), ended, infos

    def close(self) -> None:
        """Close nothing: there are no processes and no windows."""
        self._inner.close()

    def get_images(self) -> Sequence[Picture]:
        """Draw every engagement, each of shape (height, width, 3)."""
        return self._inner.render() or ()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute, which all environments share."""
        return [getattr(self._inner, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:  # noqa: ARG002
        """Refuse: the environments share everything, so none can be given something of its own.

        Raises:
          InputError: always.
        """
        raise InputError(f"{attr_name} can't be set on environments that run as one; make them with it")

    def env_method(self, method_name: str, *_: Any, **__: Any) -> list[Any]:
        """Refuse: there is no single environment to call.

        Raises:
          InputError: always.
        """
        raise InputError(f"{method_name} can't be called on environments that run as one")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:  # noqa: ARG002
        """Return that none is wrapped."""
        return [False] * len(list(self._get_indices(indices)))
