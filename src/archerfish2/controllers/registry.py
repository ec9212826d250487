"""Controllers by name, each built for a robot and a task, and a user's own."""

import difflib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from archerfish2.arrays import single_precision
from archerfish2.controllers.kalman import ConstantVelocity, DirectAim, Predictor
from archerfish2.controllers.manoeuvring import Manoeuvring
from archerfish2.controllers.oracle import make_oracle
from archerfish2.controllers.parabola import make_parabola_aware, make_parabola_filter
from archerfish2.controllers.policy import Policy, is_training
from archerfish2.controllers.preview_aim import Hold, make_preview_aim
from archerfish2.controllers.tuning import Tuning, tuning_at
from archerfish2.errors import InputError
from archerfish2.paper.conditions import assumed_conditions, paper_tuning
from archerfish2.plugins import FORMS, find_plugin, is_plugin
from archerfish2.protocols import Controller, own_controller
from archerfish2.robot import Robot
from archerfish2.task import Task
from archerfish2.tracking.interacting_models import ModelRates
from archerfish2.tracking.kalman_filter import TrackerNoise, noise_from_record

STOP_RATE, STILL, EXACT_SD = 0.1, 0.5, 2e-4
"""What interacting models assume: rate of stopping [1/s], share that stands at first, standard deviation of detections
by a camera without noise [m]: a larger value, which does a Kalman filter good, hides turns."""


NAMES = ("kalman", "kalman-paper", "kalman-lq", "imm-lq", "parabola-lq", "no-lead", "oracle")
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
    kind = type(controller).__name__
    if kind in ("list", "tuple", "set", "dict"):
        raise InputError(f"controller: expected one, got a {kind}; give a name, a policy or an object")
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


def _build(name: str, robot: Robot, task: Task, tuning: Tuning) -> Any:
    if name == "oracle":
        return make_oracle(robot, task)
    muzzle, sensing, period = robot.muzzle_model(), robot.sensing, np.asarray(task.period_s)
    sd = np.asarray(EXACT_SD if name == "imm-lq" else assumed_conditions().kalman_position_sd)
    acceleration = np.asarray(tuning.acceleration_sd)
    noise = noise_from_record(sensing, tuning.acceleration_sd) if sensing else TrackerNoise(acceleration, sd, sd)
    noise = noise._replace(initial_speed=np.asarray(tuning.initial_speed))
    predictor: Predictor = Hold() if name == "no-lead" else ConstantVelocity(noise, np.asarray(tuning.velocity_decay))
    if name in ("kalman", "kalman-paper"):
        return DirectAim(predictor, muzzle, robot.command_limits(task), period + tuning.extra_lead_s, period)
    if name == "imm-lq":
        rates = ModelRates(*(np.asarray(each) for each in (tuning.turn_rate, STOP_RATE, STILL)))
        predictor = Manoeuvring(noise, rates, np.asarray(task.hit_radius_m), muzzle.sd[1])
    if name == "parabola-lq":  # with noise in the detections, the rule is worth something to a filter alone
        predictor = make_parabola_filter(task, muzzle.sd[1], noise) if sensing else make_parabola_aware(task)
    return make_preview_aim(predictor, robot, task, smoothing=tuning.smoothing, lead_s=tuning.extra_lead_s)


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
    if name == "kalman-paper":
        if robot.digest() != type(robot).paper().digest():
            raise InputError(f"kalman-paper has settings of the paper's robot alone, got {robot.name}; take kalman")
        tuning = tuning or Tuning(**paper_tuning(task.command_limit)[name])
    if name in NAMES:
        return single_precision(_build(name, robot, task, tuning or tuning_at(name)))
    if name and not is_plugin(name, "controller") and not name.endswith(".py"):
        near = difflib.get_close_matches(name.lower(), NAMES, 1)
        meant = f"perhaps you meant {near[0]}" if near else "name one of these"
        expected = f"{', '.join(NAMES)}, or one of your own ({FORMS})"
        raise InputError(f"controller must be one of {expected}, got {name!r}; {meant}")
    return own_controller(name or controller, robot, task)
