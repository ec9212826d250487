"""The clock of trainings by Stable-Baselines3 and by what is built on it."""

from collections.abc import Callable

from stable_baselines3.common.callbacks import BaseCallback
from training_protocol import Log, Policy


class Clock(BaseCallback):
    """Notes when an iteration, rollout and update, has passed."""

    def __init__(self, log: Log, policy: Callable[[], Policy]) -> None:
        super().__init__()
        self._log, self._policy = log, policy

    def _on_training_start(self) -> None:
        self._log.begin()

    def _on_rollout_start(self) -> None:
        # The beginning of a rollout is the end of the update before it.
        if self.num_timesteps:
            self._log.passed(self.num_timesteps, self._policy)

    def _on_training_end(self) -> None:
        self._log.passed(self.num_timesteps, self._policy)

    def _on_step(self) -> bool:
        return True
