"""Every array of every decision of a few engagements: to look at, or to work on in a notebook."""

from __future__ import annotations  # so that help() names the types, rather than what they stand for

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.arrays import Array, map_arrays
from archerfish.controllers.registry import ControllerLike
from archerfish.controllers.tuning import TuningLike
from archerfish.dynamics.aiming import line_of_sight
from archerfish.errors import InputError
from archerfish.evaluation.contenders import as_contenders, prepared
from archerfish.evaluation.draws import check_counts, draw
from archerfish.evaluation.run import decisions
from archerfish.evaluation.tuning_search import settings
from archerfish.protocols import Command, Controller, Engagement, Seen, Shot, World
from archerfish.robot import Robot, RobotLike
from archerfish.simulation.user_world import WorldLike, find_world
from archerfish.task import Task, TaskCell, TaskLike

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
        decisions = len(self.times)
        engagements, rate, fields = self.hit.size // decisions, 100 * self.hit.mean(), ", ".join(self._fields)
        return f"Trajectory({engagements} engagements of {decisions} decisions, {rate:.1f} % hit; {fields})"

    def to_dicts(self) -> list[dict[str, Any]]:
        """Return a row per decision for a data frame: what was commanded, and what became of the shot."""
        engagement, decision = np.indices(self.hit.shape)
        columns: dict[str, Any] = {"engagement": engagement, "decision": decision, "time_s": self.times[decision]}
        angles = {"command": self.command.angle, "in_force": self.in_force, "gimbal": self.shot.angle}
        for name, angle in angles.items():
            columns |= {f"{name}_pitch_rad": angle[..., 0], f"{name}_yaw_rad": angle[..., 1]}
        columns |= {f"target_{axis}_m": self.target[..., place] for place, axis in enumerate("xyz")}
        columns |= {"fired": self.shot.fired, "hit": self.hit, "margin_m": self.shot.margin}
        columns |= {"miss_left_m": self.shot.miss[..., 0], "miss_up_m": self.shot.miss[..., 1]}
        columns["flight_time_s"] = self.shot.flight_time
        rows = zip(*(values.ravel().tolist() for values in columns.values()), strict=True)
        return [dict(zip(columns, row, strict=True)) for row in rows]

    def plot(self, engagement: int = 0) -> Figure:
        """Draw yaw, pitch and miss of an engagement against time.

        Raises:
          InputError: if there is no engagement of that number.
        """
        from archerfish.evaluation.plots import trajectory

        count = len(self.hit)
        if not -count <= engagement < count:
            raise InputError(f"plot: engagement must be 0…{count - 1}, got {engagement}; choose one of these")
        away = np.degrees(np.asarray(line_of_sight(self.target[engagement])))
        commands, angles = np.degrees(self.in_force[engagement]), np.degrees(self.shot.angle[engagement])
        period = float(self.times[1] - self.times[0]) if len(self.times) > 1 else 0.0
        return trajectory(self.times + period, away, commands, angles, self.shot.miss[engagement], self.hit[engagement])


def rollout(
    controller: ControllerLike,
    robot: RobotLike = None,
    task: TaskLike = "any",
    *,
    world: WorldLike | None = None,
    engagements: int = 16,
    seed: int = 0,
    tuning: TuningLike = "kept",
) -> Trajectory:
    """Let a controller shoot in a few engagements of the task's longest length, spread evenly over its cells.

    Args:
      controller: one, as `evaluate` takes it.
      robot: as `evaluate` takes it; the paper's if not given.
      task: or its name or TOML file.
      world: where to shoot instead of in the robot's simulator, as `evaluate` takes it.
      engagements: N, at most as many as 4 GB have room for.
      seed: of engagements and dispersion.
      tuning: of a classical controller, as `evaluate` takes it.

    Raises:
      InputError: if something that was given can't be used, or a user's code fails.
    """
    robot, task = Robot.of(robot), Task.of(task)
    part = task.replace(lengths_s=task.lengths[-1:])
    arena, cells = find_world(world, robot, part), part.cells()
    check_counts(engagements, seed, 1, cells[:1], arena.normals + _KEPT)
    (contender,) = as_contenders({"controller": controller})
    if contender.kind == "perfect":
        raise InputError("perfect aim has no trajectory; name a controller")
    made: Any = prepared([contender], arena, robot, part).get(0)
    if contender.is_tuned:
        made = contender.make(robot, part, settings([contender], tuning, robot, task).get(contender.name))
    return run_engagements(arena, made, *draw_in_turn(cells, engagements, seed, arena))


def draw_in_turn(cells: Sequence[TaskCell], engagements: int, seed: int, world: World) -> tuple[Engagement, Array]:
    """Draw engagements, one of each of the S cells after the other, and the normals of all their decisions.

    Args:
      cells: of one length.
      engagements: N, of which number i is of cell i modulo S.
      seed: of the draws.
      world: that they are for.

    Returns:
      Engagements of shape (N,) and normals of shape (N, T, world.normals).

    Raises:
      InputError: as `draw`.
    """
    of_cell = -(-engagements // len(cells))
    engagement, normals = draw(cells, of_cell, seed, "evaluation", world.normals, world.plants)
    in_turn = [place % len(cells) * of_cell + place // len(cells) for place in range(engagements)]
    return map_arrays(lambda values: values[in_turn], engagement), normals[in_turn]


def run_engagements(
    world: World, controller: Controller, engagement: Engagement, normals: Array, *, may_compile: bool = True
) -> Trajectory:
    """Let a controller shoot and return everything of every decision; arguments and shapes as of `decisions`."""
    axis = normals.ndim - 2  # of the decisions
    period_s, batch = np.float32(world.period_s), normals.shape[:axis]
    times = np.arange(normals.shape[axis], dtype=np.float32) * period_s
    fired_at = np.moveaxis(np.broadcast_to(times + period_s, (*batch, len(times))), axis, 0)
    target = np.moveaxis(np.asarray(engagement.target.at(fired_at).position[..., 0, :]), 0, axis)
    seen, command, in_force, shot = decisions(world, controller, engagement, normals, may_compile=may_compile)
    return Trajectory(times, seen, command, in_force, shot, target, engagement)
