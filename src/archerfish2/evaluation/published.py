"""What holds in the paper's conditions alone, and proven bounds on hit rates, each for certain engagements.

published.json has an entry for each robot (by digest, or "paper"), command limit, seed and number of engagements a
cell, and in it for static and dynamic targets a row per range: the range, the bound with its standard error of
controllers that are not given the target's path (the smaller of the hindsight and the combined bound), and that of
those that are (the hindsight bound).
"""

import functools
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

from archerfish2.evaluation.results import Cell
from archerfish2.records.json_files import plain, read_json
from archerfish2.robot import Robot
from archerfish2.task import EQ_7, Task

_LABELLED = ("name", "motion", "ranges_m", "lengths_s", "command_limit", "short_share", "still_share")
"""Fields of a task that the labels of its cells say, or that training alone uses."""


def conditions(task: Task) -> dict[str, str]:
    """Return what the cells of a task have in common, and their labels don't say; the defaults are the paper's."""
    return {name: str(value) for name, value in plain(task).items() if name not in _LABELLED}


def is_paper(robot: dict[str, str], task: Task) -> bool:
    """Whether robot, by the digests of its records, targets and shots are those of the paper's Tables II and III."""
    same = task.motion in EQ_7 and conditions(task) == conditions(Task())
    return same and robot == Robot.paper().record_digests()


def with_bounds(
    cells: Iterable[Cell], robot: Robot, task: Task, seed: int, *, informed: Collection[str] = ("oracle",)
) -> tuple[Cell, ...]:
    """Return cells with the published bounds; without where none is published, and for perfect aim.

    Args:
      cells: of the robot's own simulator.
      robot: bounds hold for equal records alone, not for its name.
      task: of the paper's targets; others have no bound.
      seed: of the evaluation.
      informed: names of the controllers that are given the target's path.
    """
    own = task.motion in EQ_7 and conditions(task) == conditions(Task())
    names = {robot.digest(), *(["paper"] if robot.digest() == Robot.paper().digest() else [])}
    found: dict[Any, Any] = {
        (each["command_limit"], each["engagements"], motion, tuple(row[0])): row[1:]
        for each in _published()
        if own and each["robot"] in names and each["seed"] == seed
        for motion in ("static", "dynamic")
        for row in each[motion]
    }

    def bounded(cell: Cell) -> Cell:
        row = found.get((cell.command_limit, cell.engagements, cell.motion, cell.range_m))
        if row is None or cell.length_s != 1.0 or cell.kind == "perfect":
            return cell
        bound, error = row[cell.controller in informed]
        return cell.replace(bound=bound, bound_error=error)

    return tuple(map(bounded, cells))


@functools.cache
def _published() -> list[Any]:
    return list(read_json(Path(__file__).with_name("published.json"))["bounds"])
