"""One training as a task: what it is given, what it leaves, how that reaches the disk."""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archerfish.cli.early_stop import hit_rate_stop, stopping_suites
from archerfish.cli.live_run import LiveRun
from archerfish.cli.setting import Setting, setting_world
from archerfish.cli.training_folders import DIVERGED, FAULT
from archerfish.cli.training_log import LOG, log_rows, log_text
from archerfish.controllers.policy import policy_to_record
from archerfish.dynamics.linear_axis import gimbal_model, ramp_response
from archerfish.figures.style import save_figure
from archerfish.figures.training import learning_curves
from archerfish.learning.checkpoint import write_checkpoint
from archerfish.learning.config import PpoConfig
from archerfish.learning.gradient import GRADIENT
from archerfish.learning.gradient_config import GradientConfig
from archerfish.learning.ppo import Learner
from archerfish.learning.training import (
    PPO,
    Course,
    Curve,
    DivergenceError,
    Standing,
    Trained,
    Trainer,
    curve,
    decisions,
    train,
    trained_policy,
    weights_hash,
)
from archerfish.records import storage
from archerfish.records.errors import InputError
from archerfish.records.policy import PolicyRecord, write_policy
from archerfish.records.provenance import provenance
from archerfish.simulation.assembly import environment_in, observer_in
from archerfish.simulation.environment import ShootingEnvironment
from archerfish.simulation.reward import EQ_8, Reward
from archerfish.simulation.scenario import LONG_S, SHORT
from archerfish.targets.own_motion import find_motion

TRAINERS: dict[str, Trainer] = {"ppo": PPO, "gradient": GRADIENT}
"""Name → way of training; its settings are the field of that name in a `TrainingTask`."""
HIT_WORTH = 0.1
"""What a hit adds to a reward [m], where it adds anything."""
SMOOTH = Reward(*(np.float32(each) for each in (0.1, HIT_WORTH, 0.012)))
"""For the gradient trainer: mostly a smooth hit, and enough of the distance to lead there from afar."""
COUNTED = Reward(hit=np.float32(HIT_WORTH))
"""For PPO, where targets may turn back: a hit counts in itself."""
REWARDS: dict[str, dict[str, Reward]] = {
    "ppo": {"history": EQ_8, "paper": EQ_8, "tracked": COUNTED, "multimodel": COUNTED},
    "gradient": {"history": SMOOTH, "paper": EQ_8, "tracked": SMOOTH, "multimodel": SMOOTH},
}
"""Trainer → kind of observation → what a decision is worth; the paper's six numbers get the paper's eq (8)."""


def sees_truth(trainer: str, observation: str) -> bool:
    """Tell whether a critic is to see where the target really is and will be: where the policy sees old sights.

    Args:
      trainer: one of `TRAINERS`.
      observation: kind of what the policy sees.
    """
    # Training by gradients has no critic.
    return observation == "tracked" or (observation == "multimodel" and trainer == "ppo")


@dataclass(frozen=True)
class TrainingTask:
    """A training, as data: it can be handed to another process."""

    setting: Setting
    """The robot."""
    static_share: float
    """Share of the targets that stand still."""
    observation: str
    """"history", "paper", "tracked" or "multimodel"."""
    frames: int
    """Frames that a history observation remembers."""
    command_limit: str
    """What the gimbal may be asked."""
    ppo: PpoConfig
    """Settings."""
    seed: int
    """Of everything random."""
    asymmetric: bool = False
    """Whether the critic sees where the target really is and will be."""
    stop_at_hit_rate: float | None = None
    """Hit rate, 0…1, whose certainty ends the training early; see `early_stop`."""
    trainer: str = "ppo"
    """One of `TRAINERS`."""
    gradient: GradientConfig = field(default_factory=GradientConfig)
    """Settings, for the trainer of that name."""
    motion: str = ""
    """How moving targets move, as `find_motion` takes it; as eq (7) says if empty."""
    target: str = ""
    """One of `targets.drawn`, in the place of the paper's targets; then share and motion above don't count."""

    @property
    def config(self) -> PpoConfig | GradientConfig:
        """Settings of the trainer."""
        return self.gradient if self.trainer == "gradient" else self.ppo

    @property
    def decisions(self) -> int:
        """Decisions of the whole training."""
        return decisions(self.config)

    @property
    def reward(self) -> Reward:
        """What a decision is worth."""
        return REWARDS[self.trainer][self.observation]

    @property
    def mean_length(self) -> float:
        """Decisions of an engagement, on average."""
        conditions = self.setting.conditions
        if not self.target:
            return conditions.decisions
        share, short_s = SHORT
        return (share * short_s + (1.0 - share) * LONG_S) / conditions.control_period_s

    def facts(self) -> dict[str, Any]:
        """Return what a run folder's config.json holds of a training that is part of a larger run."""
        names = ("static_share", "observation", "frames", "command_limit", "seed", "asymmetric", "trainer")
        return {
            "setting": self.setting.name,
            **{name: getattr(self, name) for name in names},
            **({"target": self.target} if self.target else {}),
            self.trainer: asdict(self.config),
            "reward": {name: float(value) for name, value in self.reward._asdict().items()},
            "conditions": asdict(self.setting.conditions),
        }


@dataclass(frozen=True)
class TrainingResult:
    """What a training leaves."""

    policy: PolicyRecord
    """The policy."""
    learner: Learner
    """Where training stands."""
    curve: Curve
    """How it went."""
    mean_return: NDArray[np.float64]
    """Mean return of an engagement in training [m], shape (K,)."""
    seconds: float
    """Wall time, compilation included."""
    weights_sha256: str
    """Hash of the final weights."""


def run_task(
    task: TrainingTask, advance: Callable[[float, str], None] = lambda *_: None, live: LiveRun | None = None
) -> TrainingResult:
    """Train.

    Args:
      task: what.
      advance: receives the decisions trained for.
      live: folder of the training in progress; without, nothing is written.

    Raises:
      InputError: if the training diverges; the folder then holds what it was before, and what reproduces it.
    """
    begun = time.monotonic()
    environment = _environment(task)
    batch, length, best = task.config.batch, task.mean_length, 0.0

    def tell(standing: Standing) -> None:
        nonlocal best
        best = max(best, _hit_share(standing))
        advance(standing.iterations * batch, _note(standing, length, best))

    def resume(fresh: Standing) -> Standing:
        standing = fresh if live is None else live.resume(fresh)
        if standing.iterations:
            tell(standing)
        return standing

    def watch(standing: Standing) -> None:
        tell(standing)
        if live is not None:
            live.watch(standing)

    suites = stopping_suites(task.setting, environment, task.static_share, task.motion, task.target)
    enough = hit_rate_stop(task.stop_at_hit_rate, task.setting, environment, suites, task.seed)
    course = Course(resume, watch, enough)
    try:
        trained = train(environment, task.config, task.seed, trainer=TRAINERS[task.trainer], course=course)
    except DivergenceError as error:
        if live is None:
            raise
        before = Trained(error.standing.learner, curve(error.standing, batch))
        raise keep_diverged(live, error, _result(task, environment, before, begun)) from error
    if live is not None:
        live.finish(Standing(trained.learner, (trained.curve.metrics,)))
    return _result(task, environment, trained, begun)


def _environment(task: TrainingTask) -> ShootingEnvironment:
    setting = task.setting
    world = setting_world(setting, task.command_limit)
    observer = observer_in(world, task.observation, task.frames, setting.muzzle, setting.sensing, task.command_limit)
    motion = find_motion(task.motion) if task.motion else None
    return environment_in(
        world, setting.conditions, observer, task.static_share, task.reward, task.asymmetric, motion, task.target
    )


def _ramp(setting: Setting) -> dict[str, float]:
    """Return how the robot follows commands that change at a constant rate, as the record has it."""
    period, sensing = setting.conditions.control_period_s, setting.sensing
    latency = (sensing.link.command_latency or 0.0) if sensing else 0.0
    found = ramp_response(gimbal_model(setting.pitch, setting.yaw, period, latency), period)
    pitch, yaw = (float(each) for each in found.gain)
    return {"pitch_gain": pitch, "yaw_gain": yaw, "lead": float(found.lead[1])}


def _result(task: TrainingTask, environment: ShootingEnvironment, trained: Trained, begun: float) -> TrainingResult:
    setting, conditions = task.setting, task.setting.conditions
    mean_return = trained.curve.mean_reward.astype(float) * task.mean_length
    policy = policy_to_record(
        trained_policy(environment.observer, trained.learner),
        period_s=conditions.control_period_s,
        command_limit=task.command_limit,
        ramp=_ramp(setting) if task.observation == "multimodel" else {},
        training={
            **{name: getattr(task, name) for name in ("static_share", "seed")},
            "setting": setting.name,
            **({"motion": task.motion} if task.motion else {}),
            **({"target": task.target} if task.target else {}),
            task.trainer: asdict(task.config),
            "mean_return": float(mean_return[-1]) if len(mean_return) else None,
        },
        provenance=provenance(task.seed, setting.inputs),
    )
    digest = weights_hash(trained.learner)
    return TrainingResult(policy, trained.learner, trained.curve, mean_return, time.monotonic() - begun, digest)


def _note(standing: Standing, length: float, best: float) -> str:
    """Return the words beside the progress bar: return and share of hits of the last rollouts, and the best share."""
    said = f"{length * float(standing.parts[-1].mean_reward[-1]):.2f} m"
    return f"{said}, hit {_hit_share(standing):.1%} ({best:.1%})"


def _hit_share(standing: Standing) -> float:
    return float(np.mean(standing.parts[-1].hit_share))


def keep_diverged(live: LiveRun, error: DivergenceError, result: TrainingResult) -> InputError:
    """Write what a training that diverged leaves, and return the error that says where.

    Args:
      live: its folder, which is renamed: there is nothing to go on with.
      error: what happened.
      result: of the training up to there.
    """
    live.save(error.standing)
    configuration = storage.read_json(live.folder / "config.json")
    write_run(live.folder, result, configuration)
    fault = {"iteration": error.iteration, "first_not_finite": error.first, "message": str(error)}
    storage.write_json(live.folder / FAULT, fault)
    live.set_aside()
    return InputError(f"{error}; {live.out / DIVERGED} holds the policy of before, and what reproduces it")


def write_run(folder: Path, result: TrainingResult, configuration: dict[str, Any]) -> None:
    """Write a run folder: policy, checkpoint, log, learning curve and configuration.

    Args:
      folder: is made if missing.
      result: of the training.
      configuration: the resolved configuration.
    """
    batch = int(result.curve.steps[0]) if len(result.curve.steps) else 0
    figure = learning_curves(result.curve.steps, {f"seed {result.policy.training['seed']}": result.mean_return})
    storage.write_json(folder / "config.json", configuration)
    storage.write_text(folder / LOG, log_text(log_rows(result.curve.metrics, batch)))
    save_figure(folder / "curve.svg", figure)
    write_checkpoint(folder / "checkpoint.json", result.learner, {"configuration": configuration})
    write_policy(folder / "policy.json", result.policy)
