"""Adapter: PPO of RLtools, compiled by its Python package for our Gymnasium environment, one at a time.

The package steps environments that are written in Python one after the other from C++, which takes a third of its time
here. The rest are its own loops: as it comes from PyPI it finds no library for matrix products but one of Intel's that
it would download, and is built without. Only an environment written anew in C++, linked by hand, would show what it can
do. Its policy comes out as C++ source, not as arrays: only the speed of training is measured.
"""

import math
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
from rltools import PPO
from training_protocol import ACTION_BOUND, Case, Log, Policy, main, shooting_environment

from archerfish.simulation.gymnasium_env import ShootingEnv

ENGAGEMENT = 50
"""Decisions of an engagement; compiled into the program."""


def train(case: Case, log: Log) -> None:
    """Train with one learning rate and the package's own Adam; it has no bound on the gradient."""
    made = shooting_environment()
    loop = PPO(
        lambda: _Rescaled(ShootingEnv(made, action_bound=ACTION_BOUND)),
        enable_evaluation=False,
        interface_name=f"archerfish_{case.environments}_{case.hidden}",
        GAMMA=case.discount,
        LAMBDA=case.trace,
        EPSILON_CLIP=case.clip,
        INITIAL_ACTION_STD=math.exp(case.log_std) / ACTION_BOUND,
        ACTION_ENTROPY_COEFFICIENT=0.0,
        NORMALIZE_OBSERVATIONS=True,
        N_EPOCHS=case.epochs,
        STEP_LIMIT=case.iterations,
        ACTOR_HIDDEN_DIM=case.hidden,
        ACTOR_NUM_LAYERS=2,
        CRITIC_HIDDEN_DIM=case.hidden,
        CRITIC_NUM_LAYERS=2,
        EPISODE_STEP_LIMIT=ENGAGEMENT,
        N_ENVIRONMENTS=case.environments,
        ON_POLICY_RUNNER_STEPS_PER_ENV=case.rollout,
        BATCH_SIZE=case.batch // case.minibatches,
        OPTIMIZER_ALPHA=case.learning_rate,
    )
    log.begin()
    state = loop.State(case.seed)
    for done in range(1, case.iterations + 1):
        state.step()
        log.passed(done * case.batch, _no_policy)


class _Rescaled:
    """Takes actions from −1 to 1, and says how long an engagement lasts, as the package wants it."""

    def __init__(self, env: ShootingEnv) -> None:
        self._env = env
        self.observation_space = env.observation_space
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, env.action_space.shape, np.float32)
        self.spec = SimpleNamespace(max_episode_steps=ENGAGEMENT)

    def reset(self) -> Any:
        return self._env.reset()

    def step(self, action: Any) -> Any:
        return self._env.step(ACTION_BOUND * np.asarray(action))


def _no_policy() -> Policy:
    raise NotImplementedError("RLtools writes its policy as C++ source")


if __name__ == "__main__":
    main(train)
