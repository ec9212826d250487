"""Adapter: PPO of SBX, Stable-Baselines3 with its networks in JAX, in our vector environment made for that."""

import jax.numpy as jnp
import numpy as np
import torch
from flax import linen
from sb3_clock import Clock
from sb3_settings import normalised_environments, ppo_settings
from sbx import PPO
from training_protocol import Case, Log, Policy, main


def train(case: Case, log: Log) -> None:
    """Train with one learning rate, observations normalised as ours are."""
    torch.set_num_threads(case.threads)
    model = PPO(
        "MlpPolicy",
        normalised_environments(case),
        **ppo_settings(case),
        policy_kwargs={
            "net_arch": [case.hidden],
            "activation_fn": linen.relu,
            "log_std_init": case.log_std,
            "ortho_init": True,
        },
    )
    model.learn(case.iterations * case.batch, callback=Clock(log, lambda: _policy(model)))


def _policy(model: PPO) -> Policy:
    seen = model.get_vec_normalize_env().obs_rms
    dense = model.policy.actor_state.params["params"]
    layers = tuple((np.asarray(dense[name]["kernel"]), np.asarray(dense[name]["bias"])) for name in sorted_dense(dense))
    return Policy(seen.mean, seen.var, layers)


def sorted_dense(parameters: dict[str, dict[str, jnp.ndarray]]) -> list[str]:
    """Return the names of the dense layers, first to last."""
    return sorted(name for name in parameters if name.startswith("Dense_"))


if __name__ == "__main__":
    main(train)
