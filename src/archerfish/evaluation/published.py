"""What holds in the paper's conditions alone, and proven bounds on hit rates, each for certain engagements.

published.json has an entry for each robot (by digest, or "paper"), command limit, seed and number of engagements a
cell, and in it for static and dynamic targets a row per range: the range, the bound with its standard error of
controllers that are not given the target's path (the smaller of the hindsight and the combined bound), and that of
those that are (the hindsight bound).
"""

import functools
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from archerfish.paper.tables import printed_rate
from archerfish.records.json_files import read_json
from archerfish.robot import Robot
from archerfish.task import EQ_7, Task

if TYPE_CHECKING:
    from archerfish.evaluation.results import Cell


def is_paper(robot: dict[str, str], task: Task) -> bool:
    """Whether robot, by the digests of its records, targets and shots are those of the paper's Tables II and III."""
    same = task.motion in EQ_7 and task.conditions() == Task().conditions()
    return same and robot == Robot.paper().record_digests()


def printed_for(controller: Any, table: str, range_m: tuple[float, float]) -> float | None:
    """Return the paper's figure for a controller [%], None of one that the paper has not.

    Args:
      controller: "kalman-paper", or a policy that sees what the paper's sees and was trained as that was.
      table: "II" or "III".
      range_m: smallest and largest distance [m].
    """
    facts = getattr(controller, "facts", None)
    if facts is None:
        is_papers = isinstance(controller, str) and controller == "kalman-paper"
        return printed_rate(table, range_m, controller) if is_papers else None
    sees_as_papers = facts.observer.observation == ("paper",) and facts.task.motion == "paper"
    return printed_rate(table, range_m, "", is_policy=sees_as_papers and is_paper(facts.robot, facts.task))


def with_bounds(
    cells: Iterable["Cell"], robot: Robot, task: Task, seed: int, *, informed: Collection[str] = ("oracle",)
) -> tuple["Cell", ...]:
    """Return cells with the published bounds; without where none is published, and for perfect aim.

    Args:
      cells: of the robot's own simulator.
      robot: bounds hold for equal records alone, not for its name.
      task: of the paper's targets; others have no bound.
      seed: of the evaluation.
      informed: names of the controllers that are given the target's path.
    """
    if task.motion not in EQ_7 or task.conditions() != Task().conditions():
        return tuple(cells)
    name, bounds = "paper" if robot.digest() == Robot.paper().digest() else robot.digest(), dict[Any, Any]()
    for entry in _published():
        if (entry["robot"], entry["seed"]) == (name, seed):
            for motion in ("static", "dynamic"):
                for range_m, *both in entry[motion]:
                    bounds[entry["command_limit"], entry["engagements"], motion, tuple(range_m), 1.0] = both
    bounded = []
    for cell in cells:
        both = bounds.get((cell.command_limit, cell.engagements, cell.motion, cell.range_m, cell.length_s))
        if both is None or cell.kind == "perfect":
            bounded.append(cell)
        else:
            bound, error = both[cell.controller in informed]
            bounded.append(cell.replace(bound=bound, bound_error=error))
    return tuple(bounded)


@functools.cache
def _published() -> list[Any]:
    return list(read_json(Path(__file__).with_name("published.json"))["bounds"])
