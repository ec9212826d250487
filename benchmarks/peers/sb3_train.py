"""Adapter: PPO of Stable-Baselines3 on the CPU, in our vector environment made for it."""

import torch
from sb3_clock import Clock
from sb3_settings import normalised_environments, ppo_settings
from stable_baselines3 import PPO
from training_protocol import Case, Log, Policy, main


def train(case: Case, log: Log) -> None:
    """Train with one learning rate, observations normalised as ours are."""
    torch.set_num_threads(case.threads)
    model = PPO(
        "MlpPolicy",
        normalised_environments(case),
        **ppo_settings(case),
        policy_kwargs={
            "net_arch": {"pi": [case.hidden], "vf": [case.hidden]},
            "activation_fn": torch.nn.ReLU,
            "log_std_init": case.log_std,
        },
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
