"""The evaluation of any controllers in any world: engagements drawn once, hits counted."""

from __future__ import annotations  # so that help() names the types, rather than what they stand for

import time
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from archerfish import provenance
from archerfish.controllers.registry import ControllerLike
from archerfish.controllers.tuning import TuningLike
from archerfish.evaluation.contenders import Contender, as_contenders, prepared, unlike_training
from archerfish.evaluation.draws import check_counts, draw
from archerfish.evaluation.published import is_paper, printed_for, with_bounds
from archerfish.evaluation.results import Cell, Results
from archerfish.evaluation.run import Counted, count, count_perfect_aim, is_compiled
from archerfish.evaluation.tuning_search import settings
from archerfish.plugins import find_plugin
from archerfish.reports import progress
from archerfish.robot import Robot, RobotLike
from archerfish.simulation.user_world import WorldLike, find_world
from archerfish.task import Task, TaskCell, TaskLike

USUAL = ("kalman", "kalman-lq", "oracle")
"""Who shoots if nobody is named."""
UNTUNED = 'Classical controllers have the settings where the search begins (tuning="start").'
"""What results say where none was tuned."""


def evaluate(
    controllers: ControllerLike | Iterable[ControllerLike] | Mapping[str, ControllerLike] = USUAL,
    robot: RobotLike = None,
    task: TaskLike = "any",
    *,
    world: WorldLike | None = None,
    engagements: int = 500,
    seed: int = 0,
    tuning: TuningLike = "kept",
) -> Results:
    """Count the hits of controllers on the same engagements with the same dispersion draws.

    Args:
      controllers: one, several, or a mapping from the names that results give them. Each is a name as
        `make_controller` takes it or "perfect" for perfect aim, a policy or its file or folder, an object with `reset`
        and `step`, its class, or a function of robot and task that returns one.
      robot: its records, their folder, or a result of `identify_robot`; the paper's if not given.
      task: or its name or TOML file.
      world: where to shoot instead of in the robot's simulator: a `World`, a function of robot and task that returns
        one, "./FILE.py:NAME" of either, or anything with `world(robot, task)`.
      engagements: per cell, at least 2; at most as many as 4 GB, and results.json, have room for.
      seed: of engagements and dispersion.
      tuning: of classical controllers. "kept": searched for where nothing is kept for robot and task, on draws that no
        evaluation has, and written to tuning.json in the robot's folder, or for a robot without one in the user's
        cache. "start": where that search begins. A `Tuning`, or a mapping from names to one: as given.

    Raises:
      InputError: if something that was given can't be used, or a user's code fails.
    """
    begun = time.monotonic()
    robot, task = Robot.of(robot), Task.of(task)
    arena, contenders = find_world(world, robot, task), as_contenders(controllers)
    parts = [task.replace(lengths_s=(length,)) for length in task.lengths]
    counts = len(contenders) * sum(len(part.cells()) for part in parts)
    check_counts(engagements, seed, 2, parts[-1].cells(), arena.normals, counts)
    made = [prepared(contenders, arena, robot, part) for part in parts]
    checked = time.monotonic()
    tunings = settings(contenders, tuning, robot, task)
    tuned = time.monotonic()
    is_tabled = world is None and is_paper(robot.record_digests(), task)
    cells, done = list[Cell](), 0
    total = engagements * sum(cell.decisions for part in parts for cell in part.cells()) * len(contenders)
    compiling = "compiling" if is_compiled(arena) else ""
    with progress.bar("evaluating", total, "shots", compiling) as advance:
        for part, controllers_of_length in zip(parts, made, strict=True):
            task_cells = part.cells()
            engagement, normals = draw(task_cells, engagements, seed, "evaluation", arena.normals, arena.plants)
            for place, contender in enumerate(contenders):
                if contender.is_tuned:
                    controllers_of_length[place] = contender.make(robot, part, tunings.get(contender.name))

                def report(members: int, before: int = done, name: str = contender.name) -> None:
                    advance(before + members * normals.shape[1], name)  # noqa: B023 (called in this round alone)

                controller = controllers_of_length[place]
                begins = f"{compiling}, " if compiling and is_compiled(controller) else ""
                advance(done, f"{begins}{contender.name}")
                if controller is None:
                    counted = count_perfect_aim(arena, engagement, normals)
                else:
                    counted = count(arena, controller, engagement, normals, report)
                done += counted.hit.size
                report(len(normals))
                cells += _cells(task_cells, contender, counted, arena.name, task, is_tabled)
    ended = time.monotonic()
    motion = task_cells[-1].scenario.motion
    remarks = [unlike_training(contender, robot, task) for contender in contenders]
    remarks += [UNTUNED] if tunings and tuning == "start" else []
    informed = {c.name for place, c in enumerate(contenders) if getattr(made[0][place], "needs_truth", False)}
    stages = {"checks": checked - begun, "tuning": tuned - checked, "evaluation": ended - tuned}
    return Results(
        seed=seed,
        commit=provenance.code_commit(),
        versions=provenance.library_versions(),
        tasks=(task,),
        robots={arena.name: _conditions(robot, world)},
        motions={motion.name: motion.digest} if hasattr(motion, "digest") else {},
        tuning={f"{arena.name}/{task.command_limit}/{task.name}/{name}": found for name, found in tunings.items()},
        cells=with_bounds(cells, robot, task, seed, informed=informed) if world is None else tuple(cells),
        remarks=tuple(remark for remark in remarks if remark),
        durations={stage: round(seconds, 2) for stage, seconds in stages.items()},
    )


def _conditions(robot: Robot, world: WorldLike | None) -> dict[str, str]:
    """Return what the cells of a world have in common, and their labels don't say."""
    muzzle, conditions = robot.muzzle, {"robot": robot.name, "digest": robot.digest()}
    conditions["muzzle"] = (
        f"{muzzle.speed:.4g} m/s ± {muzzle.speed_sd:.2g}, dispersion {1e3 * muzzle.pitch_sd:.3g} mrad in pitch and "
        f"{1e3 * muzzle.yaw_sd:.3g} in yaw, drag {muzzle.drag:.3g} 1/m"
    )
    conditions["assumed"] = ", ".join(robot.assumed)
    if world is not None:
        plugin = find_plugin(world, "world")
        conditions["world"] = f"{plugin.spec} {plugin.digest[:16]}".strip()
    return conditions


def _cells(
    task_cells: tuple[TaskCell, ...], contender: Contender, counted: Counted, world: str, task: Task, is_tabled: bool
) -> Iterator[Cell]:
    """Yield what a contender has in the cells of one length."""
    by_cell = (len(task_cells), -1, counted.hit.shape[-1])
    hits = counted.hit.reshape(by_cell).sum(axis=2).tolist()
    withheld = (~counted.fired).reshape(by_cell).sum(axis=(1, 2)).tolist()
    changed = task.conditions() != Task().conditions()
    for place, cell in enumerate(task_cells):
        table: Any = cell.table if is_tabled and cell.range_m in Task().ranges_m else None
        yield Cell(
            world=world,
            command_limit=task.command_limit,
            length_s=cell.length_s,
            task=task.name if changed else "",
            motion=cell.motion,
            range_m=cell.range_m,
            stream=cell.stream,
            controller=contender.name,
            seed=contender.seed,
            kind=contender.kind,
            table=table,
            hits_by_engagement=hits[place],
            decisions_each=cell.decisions,
            withheld=withheld[place],
            paper=printed_for(contender.given, table, cell.range_m) if table else None,
            yaw_rad_s2=counted.yaw_acceleration,
        )
