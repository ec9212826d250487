"""Proven bounds on hit rates, published for the engagements in which they were computed (docs2/evaluation.md).

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
from archerfish2.task import Task


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
    paper = Task.load("paper")
    own = plain(task.replace(name=paper.name, motion=paper.motion, command_limit=paper.command_limit)) == plain(paper)
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
        if row is None or cell.table is None or cell.kind == "perfect":
            return cell
        bound, error = row[cell.controller in informed]
        return cell.replace(bound=bound, bound_error=error)

    return tuple(map(bounded, cells))


@functools.cache
def _published() -> list[Any]:
    return list(read_json(Path(__file__).with_name("published.json"))["bounds"])
