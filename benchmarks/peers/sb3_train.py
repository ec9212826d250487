"""Adapter: PPO of Stable-Baselines3 on the CPU, in our vector environment made for it."""

import torch
from sb3_clock import Clock
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize
from training_protocol import ACTION_BOUND, Case, Log, Policy, annealed, main, shooting_environment

from archerfish.simulation.stable_baselines import ShootingVecEnv


def train(case: Case, log: Log) -> None:
    """Train with one learning rate, observations normalised as ours are."""
    torch.set_num_threads(case.threads)
    env = ShootingVecEnv(
        case.environments, environment=shooting_environment(), action_bound=ACTION_BOUND, staggered=True
    )
    model = PPO(
        "MlpPolicy",
        VecNormalize(env, norm_reward=False, clip_obs=10.0),
        learning_rate=annealed(case),
        n_steps=case.rollout,
        batch_size=case.batch // case.minibatches,
        n_epochs=case.epochs,
        gamma=case.discount,
        gae_lambda=case.trace,
        clip_range=case.clip,
        max_grad_norm=case.gradient_norm,
        policy_kwargs={
            "net_arch": {"pi": [case.hidden], "vf": [case.hidden]},
            "activation_fn": torch.nn.ReLU,
            "log_std_init": case.log_std,
        },
        seed=case.seed,
        device="cpu",
    )
    model.learn(case.iterations * case.batch, callback=Clock(log, lambda: _policy(model)))


def _policy(model: PPO) -> Policy:
    seen = model.get_vec_normalize_env().obs_rms
    linear = (model.policy.mlp_extractor.policy_net[0], model.policy.action_net)
    layers = tuple((each.weight.detach().numpy().T, each.bias.detach().numpy()) for each in linear)
    return Policy(seen.mean, seen.var, layers)


if __name__ == "__main__":
    main(train)
