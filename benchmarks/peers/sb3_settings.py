"""What Stable-Baselines3 and what is built on it are told alike: our environment and PPO's settings."""

from typing import Any

from stable_baselines3.common.vec_env import VecNormalize
from training_protocol import ACTION_BOUND, Case, annealed, shooting_environment

from archerfish.simulation.stable_baselines import ShootingVecEnv


def normalised_environments(case: Case) -> VecNormalize:
    """Make the environments of a case, observations normalised as ours are."""
    env = ShootingVecEnv(
        case.environments, environment=shooting_environment(), action_bound=ACTION_BOUND, staggered=True
    )
    return VecNormalize(env, norm_reward=False, clip_obs=10.0)


def ppo_settings(case: Case) -> dict[str, Any]:
    """Return the settings of PPO, all but the network; one learning rate serves actor and critic."""
    return {
        "learning_rate": annealed(case),
        "n_steps": case.rollout,
        "batch_size": case.batch // case.minibatches,
        "n_epochs": case.epochs,
        "gamma": case.discount,
        "gae_lambda": case.trace,
        "clip_range": case.clip,
        "max_grad_norm": case.gradient_norm,
        "seed": case.seed,
    }
