"""The evaluation of any controllers in any world: engagements drawn once, hits counted, differences paired."""

import itertools
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from archerfish2 import provenance
from archerfish2.controllers.tuning import Tuning
from archerfish2.evaluation import contenders
from archerfish2.evaluation.draws import check_counts, draw
from archerfish2.evaluation.hit_rate import hit_rate, paired_difference
from archerfish2.evaluation.published import conditions, is_paper, with_bounds
from archerfish2.evaluation.results import Cell, Comparison, Results, pairs_to_compare
from archerfish2.evaluation.run import Counted, count, count_perfect_aim
from archerfish2.paper.tables import printed_rate
from archerfish2.protocols import World
from archerfish2.reports import progress
from archerfish2.robot import Robot
from archerfish2.simulation.user_world import find_world
from archerfish2.task import Suite, Task


class _Shots(NamedTuple):
    """What one contender did in all cells of one length."""

    contender: contenders.Contender
    counted: Counted
    hit: NDArray[np.bool_]  # (cells, engagements, T)
    fired: NDArray[np.bool_]  # (cells, engagements, T)


def evaluate(
    controllers: Any = ("kalman", "kalman-lq", "oracle"),
    robot: Robot | str | Path | None = None,
    task: Task | str | Path = "any",
    *,
    world: Any = None,
    engagements: int = 500,
    seed: int = 0,
    tuned: bool = True,
) -> Results:
    """Count the hits of controllers on the same engagements with the same dispersion draws.

    Args:
      controllers: names as `make_controller` takes them, "perfect" for perfect aim, policies, or objects with `reset`
        and `step`; or a mapping from the names that results give them.
      robot: its records, or their folder; the paper's if not given.
      task: or its name or TOML file.
      world: where to shoot instead of in the robot's simulator: a `World`, a function of robot and task that returns
        one, "./FILE.py:NAME" of either, or anything with `world(robot, task)`.
      engagements: per cell, at least 2; at most as many as 4 GB have room for.
      seed: of engagements and dispersion.
      tuned: whether classical controllers are tuned for robot and task first, on draws that no evaluation has; what is
        found is written to tuning.json in the robot's folder, or for a robot without one in the user's cache.

    Raises:
      InputError: if something that was given can't be used, or a user's code fails.
    """
    robot, task = Robot.of(robot), Task.of(task)
    moments = [time.monotonic()]
    found, named = find_world(world, robot, task), contenders.named_controllers(controllers)
    check_counts(engagements, seed, 2, task.replace(lengths_s=task.lengths[-1:]).cells(), found.normals)
    contenders.check_controllers(named, found, robot, task)
    moments.append(time.monotonic())
    tuning = contenders.tune_controllers(named, robot, task) if tuned else {}
    moments.append(time.monotonic())
    cells: list[Cell] = []
    tabled = world is None and is_paper(robot.record_digests(), task)
    comparisons, informed = list[Comparison](), set[str]()
    for suites, outcomes in _shoot(named, tuning, found, robot, task, (engagements, seed)):
        for shots, (index, suite) in itertools.product(outcomes, enumerate(suites)):
            table = suite.table if tabled and suite.range_m in Task().ranges_m else None
            cells.append(_cell(suite, index, shots, found, task, table))
        comparisons += _comparisons(suites, outcomes, found, task)
        informed |= {e.contender.name for e in outcomes if getattr(e.contender.controller, "needs_truth", False)}
    moments.append(time.monotonic())
    stages = zip(("checks", "tuning", "evaluation"), itertools.pairwise(moments), strict=True)
    return Results(
        seed=seed,
        commit=provenance.code_commit(),
        versions=provenance.library_versions(),
        tasks=(task,),
        robots={found.name: _conditions(robot, task, suites[-1])},
        tuning={f"{found.name}/{task.command_limit}": tuning} if tuning else {},
        cells=with_bounds(cells, robot, task, seed, informed=informed) if world is None else tuple(cells),
        comparisons=tuple(comparisons),
        remarks=tuple(filter(None, (contenders.unlike_training(*each, robot, task) for each in named))),
        durations={stage: round(end - begin, 2) for stage, (begin, end) in stages},
    )


def _conditions(robot: Robot, task: Task, suite: Suite) -> dict[str, str]:
    """Return what the cells of a world have in common, and their labels don't have."""
    facts = {"robot": robot.name, "digest": robot.digest(), "assumed": ", ".join(robot.assumed)}
    digest = getattr(suite.scenario.motion, "digest", "")  # of a user's motion, as it was run
    return facts | conditions(task) | {f"motion {suite.motion}": digest or "built in"}


def _shoot(
    named: list[tuple[str, Any]],
    tuning: Mapping[str, Tuning],
    world: World,
    robot: Robot,
    task: Task,
    draws: tuple[int, int],
) -> Iterator[tuple[tuple[Suite, ...], list[_Shots]]]:
    """Let all controllers shoot in the cells of each length; `draws`: engagements per cell, and their seed."""
    parts = [task.replace(lengths_s=(length,)) for length in task.lengths]
    cells = [part.cells() for part in parts]
    done, total = 0, len(named) * draws[0] * sum(suite.decisions for suites in cells for suite in suites)
    with progress.bar("evaluating", total, "shots") as advance:
        for part, suites in zip(parts, cells, strict=True):
            engagement, normals = draw(suites, *draws, "evaluation", world.normals, world.plants)
            outcomes = []
            for name, value in named:

                def report(members: int, before: int = done, each: int = normals.shape[1], name: str = name) -> None:
                    advance(before + members * each, name)

                report(0)
                one = contenders.make_contender(name, value, robot, part, tuning)
                if one.controller is None:
                    counted = count_perfect_aim(world, engagement, normals)
                else:
                    counted = count(world, one.controller, engagement, normals, report)
                done += counted.hit.size
                report(len(normals))
                by_cell = (each.reshape(len(suites), -1, each.shape[-1]) for each in (counted.hit, counted.fired))
                outcomes.append(_Shots(one, counted, *by_cell))
            yield suites, outcomes


def _cell(suite: Suite, index: int, shots: _Shots, world: World, task: Task, table: str | None) -> Cell:
    hit, fired, contender = shots.hit[index], shots.fired[index], shots.contender
    rate, counts = hit_rate(hit), ("hits", "engagements", "low", "high")
    return Cell(
        **contenders.label(suite, contender, world, task),
        table=cast(Literal["II", "III"] | None, table),
        kind=contender.kind,
        shots=int(fired.sum()),
        withheld=int((~fired).sum()),
        paper=printed_rate(table, suite.range_m, contender.word, is_policy=contender.is_papers) if table else None,
        yaw_rad_s2=shots.counted.yaw_acceleration,
        **{name: getattr(rate, name) for name in counts},
    )


def _comparisons(suites: tuple[Suite, ...], outcomes: list[_Shots], world: World, task: Task) -> Iterator[Comparison]:
    made = [each.contender for each in outcomes]
    for one, other in pairs_to_compare([(each.name, each.kind) for each in made]):
        for index, suite in enumerate(suites):
            difference = paired_difference(outcomes[one].hit[index], outcomes[other].hit[index])
            facts = {"against": made[other].name, **difference._asdict()}
            yield Comparison(**contenders.label(suite, made[one], world, task), **facts)
