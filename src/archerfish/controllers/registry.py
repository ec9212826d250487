"""Controllers by name, each built for a robot and a task, and a user's own.

A classical controller is a predictor, which says where the target will be, and a law of aiming, which turns that into
commands.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

from archerfish.arrays import single_precision
from archerfish.controllers.aiming.direct import DirectAim
from archerfish.controllers.aiming.oracle import make_oracle
from archerfish.controllers.aiming.preview_lq import PreviewAim, make_preview_aim
from archerfish.controllers.policy.policy import Policy, is_training
from archerfish.controllers.predictors.constant_velocity import ConstantVelocity
from archerfish.controllers.predictors.hold import Hold
from archerfish.controllers.predictors.interacting_models import InteractingModels
from archerfish.controllers.predictors.parabola import ParabolaFilter, make_parabola_aware
from archerfish.controllers.predictors.predictor import Predictor
from archerfish.controllers.tuning import Tuning, tuning_at
from archerfish.errors import InputError, meant
from archerfish.paper.conditions import assumed_conditions, paper_tuning
from archerfish.plugins import FORMS, find_plugin, is_plugin
from archerfish.protocols import Controller, own_controller
from archerfish.robot import Robot
from archerfish.task import Task
from archerfish.tracking.interacting_models import ModelRates
from archerfish.tracking.kalman_filter import TrackerNoise, noise_from_record
from archerfish.tracking.parabola_filter import parabola_rule

MODELS_EXACT_SD = 2e-4
"""Standard deviation of detections by a camera without noise that interacting models assume [m]: a larger value, which
does a Kalman filter good, hides turns."""


def _tracker_noise(robot: Robot, tuning: Tuning, exact_sd: float) -> TrackerNoise:
    noise = noise_from_record(robot.sensing, tuning.acceleration_sd, exact_sd)
    return noise._replace(initial_speed=tuning.initial_speed)


def _constant_velocity(robot: Robot, task: Task, tuning: Tuning) -> Predictor:  # noqa: ARG001
    noise = _tracker_noise(robot, tuning, assumed_conditions().kalman_position_sd)
    return ConstantVelocity(noise, tuning.velocity_decay)


def _interacting_models(robot: Robot, task: Task, tuning: Tuning) -> Predictor:
    noise, rates = _tracker_noise(robot, tuning, MODELS_EXACT_SD), ModelRates(tuning.turn_rate)
    return InteractingModels(noise, rates, task.hit_radius_m, robot.muzzle_model().sd[1])


def _parabola_rule(robot: Robot, task: Task, tuning: Tuning) -> Predictor:
    if robot.sensing is None:
        return make_parabola_aware(task)
    # With noise in the detections, the rule is worth something to a filter alone.
    noise = _tracker_noise(robot, tuning, assumed_conditions().kalman_position_sd)
    return ParabolaFilter(parabola_rule(task), noise, task.hit_radius_m, robot.muzzle_model().sd[1])


def _direct_aim(predictor: Predictor, robot: Robot, task: Task, tuning: Tuning) -> DirectAim:
    lead_s = task.period_s + tuning.extra_lead_s
    return DirectAim(predictor, robot.muzzle_model(), robot.command_limits(task), lead_s, task.period_s)


def _preview_aim(predictor: Predictor, robot: Robot, task: Task, tuning: Tuning) -> PreviewAim:
    return make_preview_aim(predictor, robot, task, smoothing=tuning.smoothing, lead_s=tuning.extra_lead_s)


CLASSICAL: Mapping[str, tuple[Callable[..., Predictor], Callable[..., Any]]] = {
    "kalman": (_constant_velocity, _direct_aim),
    "kalman-paper": (_constant_velocity, _direct_aim),
    "kalman-lq": (_constant_velocity, _preview_aim),
    "imm-lq": (_interacting_models, _preview_aim),
    "parabola-lq": (_parabola_rule, _preview_aim),
    "no-lead": (lambda *_: Hold(), _preview_aim),
}
"""Name → predictor, of robot, task and tuning; and law of aiming, of a predictor and these."""
NAMES = (*CLASSICAL, "oracle")
"""Of the controllers here. One of a user's own needs no line: see `make_controller`."""

ControllerLike: TypeAlias = str | Path | Controller | Callable[[Robot, Task], Any]
"""A controller as every verb takes it: a name, a policy or its file or folder, an object, a class, or a function of
robot and task."""


def load_controller(controller: ControllerLike, blocks: tuple[Any, ...] = ()) -> Any:
    """Return the policy of a file or folder, or what a name says of a user's own; anything else as it is.

    Args:
      controller: as every verb takes it.
      blocks: of a policy's observation, that are a user's own.

    Raises:
      InputError: if it can't be read or found, or there are several.
    """
    kind = type(controller)
    if kind.__module__ == "builtins" and not (isinstance(controller, str) or callable(controller)):
        expected = "a name, a policy or its folder, an object with reset and step, or a function of robot and task"
        raise InputError(f"controller: expected {expected}, got one of type {kind.__name__}; give one of these")
    if isinstance(controller, Path) and str(controller) in NAMES:
        return str(controller)
    if isinstance(controller, str | Path) and is_policy(controller):
        return Policy.load(controller, blocks)
    if isinstance(controller, str) and controller not in NAMES and is_plugin(controller, "controller"):
        return find_plugin(controller, "controller").value  # once: the file may be edited while it is used
    return controller


def is_policy(controller: Any) -> bool:
    """Whether a controller is given as a policy: by its file, or the folder of a training, which may be unfinished."""
    if not isinstance(controller, str | Path) or controller in NAMES or len(str(controller)) > 250:
        return False
    path = Path(controller)
    return is_training(path) or path.suffix == ".safetensors" or (path.is_file() and path.suffix != ".py")


def make_controller(controller: Any, robot: Robot, task: Task, tuning: Tuning | None = None) -> Any:
    """Build a controller in float32.

    Args:
      controller: one of `NAMES`, or one of a user's own: a name as `find_plugin` takes it, or an object. It has
        `reset` and `step`, or is a function of robot and task that returns such an object.
      robot: that it is built for.
      task: of one length for the oracle.
      tuning: of one of `NAMES`; where its search begins if not given.

    Raises:
      InputError: if it can't be found, is not for this robot or task, its code fails, or what is built is none.
    """
    name = str(controller) if isinstance(controller, str | Path) else ""
    if name == "oracle":
        return single_precision(make_oracle(robot, task))
    if name == "kalman-paper":
        if robot.digest() != type(robot).paper().digest():
            raise InputError(f"kalman-paper has settings of the paper's robot alone, got {robot.name}; take kalman")
        tuning = tuning or Tuning(**paper_tuning(task.command_limit)[name])
    if name in CLASSICAL:
        tuning = tuning or tuning_at(name)
        make_predictor, make_law = CLASSICAL[name]
        return single_precision(make_law(make_predictor(robot, task, tuning), robot, task, tuning))
    if name and not is_plugin(name, "controller") and not name.endswith(".py"):
        if "/" in name:
            raise InputError(f"controller {name}: there is no such file or folder; name a policy's")
        expected = f"{', '.join(NAMES)}, or one of your own ({FORMS})"
        raise InputError(
            f"controller must be one of {expected}, got {name!r}; {meant(name, NAMES, 'name one of these')}"
        )
    return own_controller(name or controller, robot, task)
