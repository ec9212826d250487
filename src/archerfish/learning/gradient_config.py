"""Settings of training by gradients through the simulator; readable without JAX."""

import math
from dataclasses import dataclass

from archerfish.records.errors import InputError


@dataclass(frozen=True)
class GradientConfig:
    """Settings of training by gradients through the simulator."""

    steps: int = 500_000
    """Decisions to train for, over all environments; rounded to whole windows, then up to calls of four."""
    environments: int = 128
    """Engagements that run side by side."""
    window: int = 16
    """Decisions that a gradient reaches back over, and that lie between two updates."""
    shards: int = 2
    """Parts that the environments are split into, to keep as many processor cores busy."""
    hidden: int = 256
    """Neurons of the first hidden layer of the policy (paper)."""
    layers: int = 2
    """Hidden layers, each with half of the neurons of the one before; the paper has one."""
    learning_rate: float = 3e-3
    """Adam step."""
    anneal: bool = True
    """The learning rate falls linearly to a twentieth, unless this is given."""
    gradient_norm: float = 0.1
    """Gradients are scaled to at most this norm."""
    engagement_norm: float = 0.3
    """On its way back through a window, the gradient of one engagement's rewards [m] by the normalised observation is
    scaled to at most this norm at every decision; a million leaves it as it is."""

    def __post_init__(self) -> None:
        for name in ("steps", "environments", "window", "shards", "hidden", "layers"):
            if getattr(self, name) < 1:
                raise InputError(f"{name} must be at least 1, got {getattr(self, name)}")
        if self.environments % self.shards:
            raise InputError(f"environments = {self.environments} must divide into shards = {self.shards} equal parts")
        for name in ("learning_rate", "gradient_norm", "engagement_norm"):
            if not 0 < getattr(self, name) < math.inf:
                raise InputError(f"{name} must be finite and > 0, got {getattr(self, name)}")
        if self.hidden >> (self.layers - 1) < 1:
            raise InputError(f"layers = {self.layers} halve hidden = {self.hidden} neurons to none; give fewer layers")

    @property
    def widths(self) -> tuple[int, ...]:
        """Neurons of each hidden layer."""
        return tuple(self.hidden >> layer for layer in range(self.layers))

    @property
    def batch(self) -> int:
        """Decisions of an iteration, over all environments."""
        return self.environments * self.window

    @property
    def iterations(self) -> int:
        """Updates of a whole run."""
        return max(1, round(self.steps / self.batch))
