"""Adapter: PPO in one file in the manner of CleanRL, in torch, in the vector environment that Gymnasium makes.

Written for this comparison: what such a file does with any continuous task, it does here. What an engagement led to is
taken from `final_obs`, and its value goes on where time is up.
"""

import math

import gymnasium
import numpy as np
import torch
from torch import Tensor, nn
from training_protocol import ACTION_BOUND, Case, Log, Policy, annealed, main

import archerfish.simulation.registration  # noqa: F401  # registers the environments

CLIP = 10.0
"""Of normalised observations, in standard deviations, as ours."""


class RunningMoments:
    """Mean and variance of all observations so far."""

    def __init__(self, size: int) -> None:
        self.mean, self.variance, self.count = np.zeros(size), np.ones(size), 0

    def add(self, batch: np.ndarray) -> None:
        """Take in a batch, shape (B, n)."""
        total = self.count + len(batch)
        shift, share = batch.mean(axis=0) - self.mean, len(batch) / total
        self.variance += share * (batch.var(axis=0) - self.variance) + share * (1.0 - share) * shift**2
        self.mean += share * shift
        self.count = total

    def scaled(self, observations: np.ndarray) -> Tensor:
        """Return observations with zero mean and unit variance, clipped."""
        units = (observations - self.mean) / np.sqrt(self.variance + 1e-8)
        return torch.as_tensor(np.clip(units, -CLIP, CLIP), dtype=torch.float32)


class Agent(nn.Module):
    """Actor and critic, a hidden layer each."""

    def __init__(self, inputs: int, actions: int, hidden: int, log_std: float) -> None:
        super().__init__()
        self.actor = nn.Sequential(_layer(inputs, hidden), nn.ReLU(), _layer(hidden, actions, 0.01))
        self.critic = nn.Sequential(_layer(inputs, hidden), nn.ReLU(), _layer(hidden, 1, 1.0))
        self.log_std = nn.Parameter(torch.full((actions,), log_std))

    def distribution(self, observation: Tensor) -> torch.distributions.Normal:
        """Return the distribution of the action."""
        return torch.distributions.Normal(self.actor(observation), self.log_std.exp())

    def value(self, observation: Tensor) -> Tensor:
        """Return what is to come, shape (B,)."""
        return self.critic(observation).squeeze(-1)


def _layer(inputs: int, outputs: int, gain: float = math.sqrt(2.0)) -> nn.Linear:
    layer = nn.Linear(inputs, outputs)
    nn.init.orthogonal_(layer.weight, gain)
    nn.init.zeros_(layer.bias)
    return layer


def train(case: Case, log: Log) -> None:
    """Train with one learning rate for actor and critic."""
    torch.set_num_threads(case.threads)
    torch.manual_seed(case.seed)
    # What `shooting_environment` builds, by its name.
    envs = gymnasium.make_vec(
        "archerfish/ShootingBox-v0", num_envs=case.environments, action_bound=ACTION_BOUND, staggered=True
    )
    size, actions = envs.single_observation_space.shape[0], envs.single_action_space.shape[0]
    agent, moments = Agent(size, actions, case.hidden, case.log_std), RunningMoments(size)
    optimiser = torch.optim.Adam(agent.parameters(), lr=case.learning_rate, eps=1e-5)
    rate = annealed(case)
    observation, _ = envs.reset(seed=case.seed)
    log.begin()
    for iteration in range(case.iterations):
        for group in optimiser.param_groups:
            group["lr"] = rate(1.0 - iteration / case.iterations)
        observation, batch = roll_out(envs, agent, moments, observation, case)
        learn(agent, optimiser, batch, case)
        log.passed((iteration + 1) * case.batch, lambda: _policy(agent, moments))


@torch.no_grad()
def roll_out(
    envs: gymnasium.vector.VectorEnv, agent: Agent, moments: RunningMoments, observation: np.ndarray, case: Case
) -> tuple[np.ndarray, tuple[Tensor, ...]]:
    """Act for a rollout.

    Returns:
      The next observation, and observations, actions, their logarithmic probabilities, advantages and returns of the
      rollout, shape (rollout · B,) first.
    """
    rows: list[tuple[Tensor, ...]] = []
    for _ in range(case.rollout):
        moments.add(observation)
        seen = moments.scaled(observation)
        chosen = agent.distribution(seen)
        action = chosen.sample()
        following, reward, terminated, truncated, infos = envs.step(action.numpy())
        led_to = following.copy()
        ended = terminated | truncated
        if ended.any():
            led_to[ended] = np.stack(infos["final_obs"][ended])
        later = agent.value(moments.scaled(led_to)) * torch.as_tensor(~terminated)
        target = torch.as_tensor(reward, dtype=torch.float32) + case.discount * later
        probability = chosen.log_prob(action).sum(-1)
        rows.append((seen, action, probability, agent.value(seen), target, torch.as_tensor(~ended)))
        observation = following
    seen, action, probability, value, target, goes_on = (torch.stack(each) for each in zip(*rows, strict=True))
    advantage, last = torch.zeros_like(value), torch.zeros(case.environments)
    for step in reversed(range(case.rollout)):
        last = target[step] - value[step] + case.discount * case.trace * goes_on[step] * last
        advantage[step] = last
    batch = (seen, action, probability, advantage, advantage + value)
    return observation, tuple(each.flatten(0, 1) for each in batch)


def learn(agent: Agent, optimiser: torch.optim.Optimizer, batch: tuple[Tensor, ...], case: Case) -> None:
    """Take the steps of an update."""
    for _ in range(case.epochs):
        for rows in torch.randperm(case.batch).chunk(case.minibatches):
            seen, action, before, advantage, returns = (each[rows] for each in batch)
            ratio = (agent.distribution(seen).log_prob(action).sum(-1) - before).exp()
            advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
            held = ratio.clamp(1.0 - case.clip, 1.0 + case.clip)
            actor_loss = -torch.min(ratio * advantage, held * advantage).mean()
            critic_loss = 0.5 * (agent.value(seen) - returns).square().mean()
            optimiser.zero_grad()
            (actor_loss + critic_loss).backward()
            nn.utils.clip_grad_norm_(agent.parameters(), case.gradient_norm)
            optimiser.step()


def _policy(agent: Agent, moments: RunningMoments) -> Policy:
    linear = [each for each in agent.actor if isinstance(each, nn.Linear)]
    layers = tuple((each.weight.detach().numpy().T, each.bias.detach().numpy()) for each in linear)
    return Policy(moments.mean, moments.variance, layers)


if __name__ == "__main__":
    main(train)
