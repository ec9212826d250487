"""What is chosen on the page, and the world, the task and the controller that follow from it."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from archerfish.controllers.registry import NAMES
from archerfish.controllers.tuning import Tuning, kept
from archerfish.errors import InputError
from archerfish.evaluation.contenders import Contender, as_contenders, prepared, unlike_training
from archerfish.records.sensing import CameraRecord, LinkRecord, SensingRecord
from archerfish.robot import Robot
from archerfish.simulation.world import make_world
from archerfish.task import Task
from archerfish.viewer.motions import motion_names

HALF_RANGE_M = 0.05
"""Distances of a trial's targets differ by so much from the chosen one [m]."""
FEEDBACK_RATE_HZ = 1000.0
"""Of the link of a robot without sensing record to which a latency is added [Hz]."""
DISTANCES_M, SPEEDS_M_S = (1.0, 8.0), (0.0, 3.0)
"""Distances and speeds that the page offers [m], [m/s]."""


@dataclass(frozen=True)
class TrialChoice:
    """What makes one trial; equal choices give equal trials."""

    controller: str
    """Name of one of the setup's controllers."""
    motion: str
    """One of `motions.motion_names`."""
    distance: float
    """Of the targets' places [m]."""
    speed: float
    """Largest, of eq (7), a user's motion and a dragged target [m/s]."""
    dispersion: float = 1.0
    """Factor on the standard deviations of the muzzle's angles."""
    camera_latency: float = 0.0
    """Added to that of the camera [s]."""
    command_latency: float = 0.0
    """Added to that of the commands [s]."""
    engagements: int = 16
    """In a trial."""
    seed: int = 0
    """Of targets and dispersion."""


class Setup(NamedTuple):
    """What stays the same while the page is open."""

    robot: Robot  # as it was loaded
    task: Task  # of one length
    controllers: Mapping[str, Contender]  # by the names on the page
    tunings: Mapping[str, Tuning]  # that are kept for robot and task, by the names on the page
    tuned_for: str  # name of the task

    def note(self, name: str) -> str:
        """Say for what a controller is tuned or trained, "" of one that is for any robot and task."""
        contender, robot = self.controllers[name], self.robot
        if not contender.is_tuned:
            return unlike_training(contender, robot, self.task)
        what = f"tuned for the robot {robot.name} and the task {self.tuned_for}"
        return f"{name} is {what}." if name in self.tunings else f"{name} is NOT {what}; archerfish evaluate tunes it."


def make_setup(robot: Robot, task: Task, controllers: Iterable[Any] = ()) -> Setup:
    """Return what a page is for: a robot, a task, the controllers that are given and the classical ones.

    Args:
      robot: that shoots.
      task: whose conditions hold, for engagements of its first length.
      controllers: names, policies or objects, as `evaluate` takes them; they come first.

    Raises:
      InputError: if a controller can't be read or used, or the tunings that are kept can't be read.
    """
    part = task.replace(lengths_s=task.lengths[:1])
    is_paper = robot.digest() == Robot.paper().digest()
    names = [name for name in NAMES if is_paper or name != "kalman-paper"]
    contenders = as_contenders(list(dict.fromkeys([*controllers, *names])))
    world = make_world(robot, part)
    prepared([contender for contender in contenders if contender.kind == "user"], world, robot, part)
    by_name = {contender.name: contender for contender in contenders}
    found = {name: kept(contender.given, robot, task) for name, contender in by_name.items() if contender.is_tuned}
    if len(by_name) < len(contenders):
        raise InputError("two controllers have one name; give one of them another folder")
    tunings = {name: tuning for name, tuning in found.items() if tuning is not None}
    return Setup(robot, part, by_name, tunings, task.name)


def first_choice(setup: Setup, **changes: Any) -> TrialChoice:
    """Return what is chosen at first: the task as it is, at the middle of its distances.

    Args:
      setup: of the page.
      changes: fields of `TrialChoice` that are given.

    Raises:
      InputError: if a distance, a number of engagements or a seed is out of bounds.
    """
    task, (near, far) = setup.task, DISTANCES_M
    middle = 0.5 * (task.ranges_m[0][0] + task.ranges_m[-1][1])
    distance, speed = min(max(middle, near), far), min(task.max_speed_m_s, SPEEDS_M_S[1])
    choice = replace(TrialChoice(next(iter(setup.controllers)), task.motion, distance, speed), **changes)
    for name, (low, high) in {"distance": DISTANCES_M, "engagements": (2, 200), "seed": (0, math.inf)}.items():
        if not low <= (value := getattr(choice, name)) <= high:
            raise InputError(f"{name} must be {low:g}…{high:g}, got {value:g}; choose one of these")
    return choice


def chosen_robot(setup: Setup, choice: TrialChoice) -> Robot:
    """Return the robot with what the page adds: other dispersion, and latencies of camera and commands.

    A robot without sensing record gets a camera and a link with no fault but the latency.
    """
    robot, muzzle = setup.robot, setup.robot.muzzle
    if choice.dispersion != 1.0:
        spread = {name: choice.dispersion * getattr(muzzle, name) for name in ("pitch_sd", "yaw_sd")}
        intervals = {name: ends for name, ends in muzzle.intervals.items() if name not in spread}
        robot = robot.replace(muzzle=muzzle.replace(**spread, intervals=intervals))
    if choice.camera_latency == choice.command_latency == 0.0:
        return robot
    sensing = robot.sensing or _exact_sensing(setup.task)
    camera, link = sensing.camera, sensing.link
    latency = (camera.latency or 0.0) + choice.camera_latency
    camera = camera.replace(latency=latency, latency_basis=camera.latency_basis or "exposure")
    link = link.replace(command_latency=(link.command_latency or 0.0) + choice.command_latency)
    return robot.replace(sensing=sensing.replace(camera=camera, link=link, intervals={}))


def _exact_sensing(task: Task) -> SensingRecord:
    """Return a camera and a link without noise and latency."""
    names = "time_offset stamp_jitter bearing_sd elevation_sd range_sd miss_probability outlier_share latency"
    exact: dict[str, Any] = dict.fromkeys(names.split(), 0.0)
    camera = CameraRecord(rate_hz=1.0 / task.period_s, noise_range=1.0, latency_basis="exposure", **exact)
    return SensingRecord(camera=camera, link=LinkRecord(feedback_rate_hz=FEEDBACK_RATE_HZ, command_latency=0.0))


def chosen_task(setup: Setup, choice: TrialChoice) -> Task:
    """Return the task with the motion, the distance and the largest speed that are chosen."""
    near, far = choice.distance - HALF_RANGE_M, choice.distance + HALF_RANGE_M
    motion = choice.motion if choice.motion in motion_names(setup.task)[:-1] else setup.task.motion
    return setup.task.replace(motion=motion, ranges_m=((near, far),), max_speed_m_s=choice.speed)


def chosen_controller(setup: Setup, choice: TrialChoice) -> Any:
    """Build the controller, which knows the robot as it was loaded: what the page adds is unknown to it.

    Raises:
      InputError: if there is none of that name, or it can't be made for robot and task.
    """
    if choice.controller not in setup.controllers:
        names = ", ".join(setup.controllers)
        raise InputError(f"controller must be one of {names}, got {choice.controller!r}; name one of these")
    contender = setup.controllers[choice.controller]
    return contender.make(setup.robot, chosen_task(setup, choice), setup.tunings.get(choice.controller))
