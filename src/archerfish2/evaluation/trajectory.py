"""Every array of every decision of a few engagements: to look at, or to work on in a notebook."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish2.arrays import map_arrays
from archerfish2.dynamics.aiming import line_of_sight
from archerfish2.errors import InputError
from archerfish2.evaluation import contenders
from archerfish2.evaluation.draws import check_counts, draw
from archerfish2.evaluation.run import run_engagements
from archerfish2.protocols import Command, Engagement, Seen, Shot
from archerfish2.robot import Robot
from archerfish2.simulation.user_world import find_world
from archerfish2.task import Task

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_KEPT = 100
"""Numbers of each decision, beside those that are drawn."""


class Trajectory(NamedTuple):
    """N engagements of T decisions, NumPy's arrays that begin with (N, T)."""

    times: NDArray[np.float32]
    """Of the decisions since the engagement began [s], shape (T,); a pellet leaves a period later."""
    seen: Seen
    """What the controller saw."""
    command: Command
    """What it asked for."""
    in_force: NDArray[np.float32]
    """Pitch and yaw command during the period, after all limits [rad], shape (N, T, 2)."""
    shot: Shot
    """What became of the shot."""
    target: NDArray[np.float32]
    """Centre of the target's first plate when the pellet leaves [m], shape (N, T, 3)."""
    engagement: Engagement
    """The engagements, shape (N,)."""

    @property
    def hit(self) -> NDArray[np.bool_]:
        """Whether each decision hit, shape (N, T)."""
        return np.asarray(self.shot.fired & (self.shot.margin >= 0.0))

    def __repr__(self) -> str:
        engagements, decisions = self.hit.shape
        rate, fields = 100 * self.hit.mean(), ", ".join(self._fields)
        return f"Trajectory({engagements} engagements of {decisions} decisions, {rate:.1f} % hit; {fields})"

    def plot(self, engagement: int = 0) -> "Figure":
        """Draw yaw, pitch and miss of an engagement against time."""
        from archerfish2.evaluation.plots import trajectory

        away = np.degrees(np.asarray(line_of_sight(self.target[engagement])))
        commands, angles = (np.degrees(each[engagement]) for each in (self.in_force, self.shot.angle))
        period = float(self.times[1] - self.times[0]) if len(self.times) > 1 else 0.0
        return trajectory(self.times + period, away, commands, angles, self.shot.miss[engagement], self.hit[engagement])


def rollout(
    controller: Any,
    robot: Robot | str | Path | None = None,
    task: Task | str | Path = "any",
    *,
    world: Any = None,
    engagements: int = 16,
    seed: int = 0,
) -> Trajectory:
    """Let a controller shoot in a few engagements of the task's longest length, spread evenly over its cells.

    Args:
      controller: as `evaluate` takes it; a classical one is tuned.
      robot: its records, or their folder; the paper's if not given.
      task: or its name or TOML file.
      world: where to shoot instead of in the robot's simulator, as `evaluate` takes it.
      engagements: N, at most as many as 4 GB have room for.
      seed: of engagements and dispersion.

    Raises:
      InputError: if something that was given can't be used, or a user's code fails.
    """
    robot, task = Robot.of(robot), Task.of(task)
    part = task.replace(lengths_s=task.lengths[-1:])
    found, cells = find_world(world, robot, part), part.cells()
    check_counts(engagements, seed, 1, cells[:1], found.normals + _KEPT)
    named = contenders.named_controllers({"controller": controller})
    contenders.check_controllers(named, found, robot, part)
    each = -(-engagements // len(cells))
    engagement, normals = draw(cells, each, seed, "evaluation", found.normals, found.plants)
    places = [place % len(cells) * each + place // len(cells) for place in range(engagements)]
    engagement, normals = map_arrays(lambda values: values[places], engagement), normals[places]
    made = contenders.make_contender(*named[0], robot, part, contenders.tune_controllers(named, robot, task)).controller
    if made is None:
        raise InputError("perfect aim has no trajectory; name a controller")
    seen, command, in_force, shot = run_engagements(found, made, engagement, normals)
    times = np.arange(normals.shape[1], dtype=np.float32) * np.float32(found.period_s)
    fired_at = (times + np.float32(found.period_s))[:, None] + np.zeros((1, engagements), np.float32)
    target = np.moveaxis(np.asarray(engagement.target.at(fired_at).position[..., 0, :]), 0, 1)
    return Trajectory(times, seen, command, in_force, shot, target, engagement)
