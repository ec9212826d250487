"""Settings of a training; readable without JAX."""

import math
from dataclasses import dataclass

from archerfish.records.errors import InputError

MAX_LOG_STD = 20.0
"""Largest magnitude of a logarithm of a standard deviation: far beyond any that learns."""
MAX_BATCH = 2**20
"""Decisions in a batch; its shuffling needs the rest of 32 bits for random ones."""


@dataclass(frozen=True)
class PpoConfig:
    """Settings of PPO; the paper's where it prints them."""

    steps: int = 2_000_000
    """Decisions to train for, over all environments; rounded to whole batches, then up to calls of four."""
    environments: int = 512
    """Engagements that run side by side."""
    rollout: int = 25
    """Decisions per environment between two updates."""
    minibatches: int = 8
    """Parts that a batch is split into."""
    epochs: int = 4
    """Passes over each batch."""
    shards: int = 2
    """Parts that the environments and every minibatch are split into, to keep as many processor cores busy; as a part
    shuffles its own decisions, another number gives other weights."""
    hidden: int = 256
    """Neurons of the hidden layer of the actor and of the critic (paper)."""
    actor_learning_rate: float = 1e-3
    """Adam step of the actor (paper)."""
    critic_learning_rate: float = 3e-3
    """Adam step of the critic (paper)."""
    anneal: bool = True
    """The learning rates fall linearly to a tenth; with no-anneal they stay as they are."""
    clip: float = 0.2
    """Clipping ε of eq (10) (paper)."""
    discount: float = 0.95
    """γ."""
    trace: float = 0.9
    """λ of the advantages."""
    entropy: float = 0.0
    """Weight of the entropy bonus."""
    gradient_norm: float = 0.5
    """Gradients are scaled to at most this norm, for each network by itself."""
    log_std: float = -1.0
    """Logarithm of the actions' standard deviation at the beginning."""
    log_std_floor: float = -4.0
    """It never falls below this."""

    def __post_init__(self) -> None:
        for name in ("steps", "environments", "rollout", "minibatches", "epochs", "shards", "hidden"):
            if getattr(self, name) < 1:
                raise InputError(f"{name} must be at least 1, got {getattr(self, name)}")
        if self.batch > MAX_BATCH:
            raise InputError(f"environments × rollout must be at most {MAX_BATCH}, got {self.batch}")
        if self.environments % self.shards:
            raise InputError(f"environments = {self.environments} must divide into shards = {self.shards} equal parts")
        if self.batch % (self.minibatches * self.shards):
            raise InputError(
                f"environments × rollout = {self.batch} must divide into minibatches × shards = "
                f"{self.minibatches} × {self.shards} equal parts"
            )
        for name in ("actor_learning_rate", "critic_learning_rate", "clip", "gradient_norm"):
            if not 0 < getattr(self, name) < math.inf:
                raise InputError(f"{name} must be finite and > 0, got {getattr(self, name)}")
        for name in ("discount", "trace"):
            if not 0 <= getattr(self, name) <= 1:
                raise InputError(f"{name} must be within 0…1, got {getattr(self, name)}")
        if not 0 <= self.entropy < math.inf:
            raise InputError(f"entropy must be ≥ 0, got {self.entropy}")
        for name in ("log_std", "log_std_floor"):
            if not -MAX_LOG_STD <= getattr(self, name) <= MAX_LOG_STD:
                raise InputError(f"{name} must be within ±{MAX_LOG_STD:g}, got {getattr(self, name)}")
        if self.log_std < self.log_std_floor:
            raise InputError(f"log_std must be at least log_std_floor = {self.log_std_floor}, got {self.log_std}")

    @property
    def batch(self) -> int:
        """Decisions of an iteration, over all environments."""
        return self.environments * self.rollout

    @property
    def iterations(self) -> int:
        """Updates of a whole run."""
        return max(1, round(self.steps / self.batch))
