"""What all training adapters share: read a case, build the environment, keep the clock, write policies and times.

An adapter is a script that runs in its tool's own environment as `python adapter.py CASE.json FOLDER`, with our package
on its path. It trains by the case and calls `Log.passed` after every iteration, which stops the clock while it writes
a policy; what the policies are worth is judged elsewhere, the same way for all of them.
"""

import json
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from archerfish.simulation.assembly import make_environment
from archerfish.simulation.environment import ShootingEnvironment

ACTION_BOUND = 5.0
"""Beyond what a trained policy asks for: nobody is held back by the bound of an action space."""


class Case(NamedTuple):
    """One training; settings named as in `PpoConfig`, one learning rate for tools that have but one."""

    environments: int
    rollout: int
    minibatches: int
    epochs: int
    hidden: int
    learning_rate: float
    critic_learning_rate: float
    discount: float
    trace: float
    clip: float
    gradient_norm: float
    log_std: float
    steps: int
    """Decisions to train for."""
    seed: int
    checkpoint_every: int
    """Decisions between two policies that are kept; none are where it is 0."""
    threads: int
    """Of a tool that has to be told; the others take what they want."""

    @property
    def batch(self) -> int:
        """Decisions of an iteration."""
        return self.environments * self.rollout

    @property
    def iterations(self) -> int:
        """Updates of the whole training."""
        return max(1, round(self.steps / self.batch))


class Policy(NamedTuple):
    """A policy's arrays: normalised observation → ReLU layers → mean action."""

    mean: Any
    """Of the observations, shape (n,)."""
    variance: Any
    """Of the observations, shape (n,)."""
    layers: tuple[tuple[Any, Any], ...]
    """Weight of shape (inputs, outputs) and bias of shape (outputs,) of each."""


class Log:
    """The clock of a training."""

    def __init__(self, case: Case, folder: Path) -> None:
        self._case, self._folder = case, folder
        self._marks: list[tuple[int, float]] = []
        self._kept: list[dict[str, Any]] = []
        self._since = time.perf_counter()

    def begin(self) -> None:
        """Start the clock."""
        self._since = time.perf_counter()

    def passed(self, steps: int, policy: Callable[[], Policy]) -> None:
        """Note that so many decisions have been trained for; keep the policy if it is time to."""
        self._marks.append((steps, time.perf_counter() - self._since))
        every, before = self._case.checkpoint_every, self._marks[-2][0] if len(self._marks) > 1 else 0
        if every and steps // every > before // every:
            name, found = f"policy_{steps}.npz", policy()
            arrays = {f"{kind}_{i}": each[i] for kind, each in _by_kind(found.layers).items() for i in range(len(each))}
            np.savez(self._folder / name, mean=found.mean, variance=found.variance, **arrays)
            self._kept.append({"steps": steps, "file": name})
        self._since = time.perf_counter()

    def write(self, before_seconds: float) -> None:
        """Write what was noted."""
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
        facts = {"before_seconds": before_seconds, "marks": self._marks, "policies": self._kept, "peak_mib": peak}
        (self._folder / "log.json").write_text(json.dumps(facts))


def _by_kind(layers: tuple[tuple[Any, Any], ...]) -> dict[str, list[Any]]:
    return {"weight": [np.asarray(each[0]) for each in layers], "bias": [np.asarray(each[1]) for each in layers]}


def shooting_environment() -> ShootingEnvironment:
    """Build what all train in: the paper's gimbal under `box`, the history observation, half of the targets still."""
    return make_environment(command_limit="box")


def annealed(case: Case) -> Callable[[float], float]:
    """Return the learning rate by the share of the training that remains, as Stable-Baselines3 wants it."""
    return lambda remaining: case.learning_rate * max(remaining, 0.1)


def main(train: Callable[[Case, Log], None]) -> None:
    """Train by the case that the command line names."""
    begun = time.perf_counter()
    case, folder = Case(**json.loads(Path(sys.argv[1]).read_text())), Path(sys.argv[2])
    log = Log(case, folder)
    train(case, log)
    log.write(time.perf_counter() - begun)
