"""A few engagements of one controller, with every array of every decision."""

from pathlib import Path
from typing import Any

from archerfish2.arrays import map_arrays
from archerfish2.controllers.registry import ControllerLike
from archerfish2.controllers.tuning import TuningLike
from archerfish2.errors import InputError
from archerfish2.evaluation.contenders import as_contenders, prepared
from archerfish2.evaluation.draws import check_counts, draw
from archerfish2.evaluation.run import run_engagements
from archerfish2.evaluation.trajectory import Trajectory
from archerfish2.evaluation.tuning import settings
from archerfish2.robot import Robot
from archerfish2.simulation.user_world import WorldLike, find_world
from archerfish2.task import Task

_KEPT = 100
"""Numbers of each decision, beside those that are drawn."""


def rollout(
    controller: ControllerLike,
    robot: Robot | str | Path | None = None,
    task: Task | str | Path = "any",
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
    of_cell = -(-engagements // len(cells))
    engagement, normals = draw(cells, of_cell, seed, "evaluation", arena.normals, arena.plants)
    in_turn = [place % len(cells) * of_cell + place // len(cells) for place in range(engagements)]
    engagement = map_arrays(lambda values: values[in_turn], engagement)
    return run_engagements(arena, made, engagement, normals[in_turn])
