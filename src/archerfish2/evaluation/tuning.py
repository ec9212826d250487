"""Tuning of the classical controllers on draws that no evaluation uses: a pattern search with expanding steps.

What a tracker should assume of its target, how far it should lead, and how smooth the commands of a preview should be,
depends on camera, link, gimbal and command limit. Every setting of a controller has a grid without ends, and settings
are compared on the same engagements with the same dispersion draws (common random numbers). From a start the search
tries the neighbours on the grid of one setting after the other, goes on with doubled steps in a direction in which more
shots hit (Hooke and Jeeves 1961), and ends where no neighbour hits more: so both neighbours of each chosen value have
been tried, and none is at an edge of what was.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from archerfish2.controllers.registry import make_controller
from archerfish2.controllers.tuning import GRIDS, Grid, Tuning, entry, keep, kept, tuning_at
from archerfish2.errors import InputError, one_line
from archerfish2.evaluation.draws import draw
from archerfish2.evaluation.run import count
from archerfish2.robot import Robot
from archerfish2.simulation.world import make_world
from archerfish2.task import Task

BUDGET = 60
"""Settings that are tried at most, per controller."""
LEAST_GAIN = 2e-4
"""A setting must hit more often by this to be taken, as a share of all shots; less is scatter."""
LONGEST_STEP = 4
"""Of the search, in steps of the grid."""
ENGAGEMENTS = 512
"""Of all cells of one length together: 64 in each of the paper's eight."""

Place = tuple[int, ...]  # indices on the grids of all settings
Progress = Callable[[int, float], None]  # settings tried, best hit rate


class Tuned(NamedTuple):
    """Settings of one controller, and how they were found."""

    tuning: Tuning
    """The best settings."""
    hit_rate: float
    """Hits per decision with them, over all cells of the tuning draws, 0…1."""
    tried: tuple[tuple[Tuning, float], ...]
    """Settings tried and their hit rates, in their order."""


def tune(name: str, robot: Robot, task: Task, progress: Progress = lambda *_: None) -> Tuning:
    """Return the settings of a controller for a robot and a task: those that are kept, else searched for and kept.

    They are kept in the robot's folder, tuning.json; those of a robot without folder in the user's cache, and those of
    the paper's robot and targets come with Archerfish.

    Args:
      name: one of `GRIDS`.
      robot: in whose simulator the controller is tuned.
      task: whose targets are engaged; on the stream "tuning", that no evaluation has.
      progress: gets how many settings have been tried, and the best hit rate.

    Raises:
      InputError: if nothing is tuned of such a controller, the world can't be built, or what is kept can't be read.
    """
    if not isinstance(name, str) or name not in GRIDS:
        given = one_line(repr(name))[:100]
        raise InputError(f"tune: name must be one of {', '.join(GRIDS)}, got {given}; other controllers are not tuned")
    tuning = kept(name, robot, task)
    if tuning is None:
        begun = entry(name, robot, task)
        found = search(name, rates(name, robot, task), progress)
        tuning = found.tuning
        keep(begun.replace(tuning=tuning, hit_rate=found.hit_rate, tried=len(found.tried)), robot)
    return tuning


def rates(name: str, robot: Robot, task: Task) -> Callable[[Tuning], float]:
    """Return the hit rate of a controller as a function of its settings, 0…1, always on the same draws."""
    world, parts = make_world(robot, task), []
    for length in task.lengths:
        part = task.replace(lengths_s=(length,))
        cells = part.cells()
        engagements = max(1, ENGAGEMENTS // max(len(cells), 8))
        parts.append((part, draw(cells, engagements, 0, "tuning", world.normals, world.plants)))

    def rate(tuning: Tuning) -> float:
        # A controller that has no use for an engagement's length has one setting for all of them.
        found = [count(world, make_controller(name, robot, part, tuning), *drawn).hit.mean() for part, drawn in parts]
        return float(sum(found) / len(found))

    return rate


def search(name: str, rate: Callable[[Tuning], float], progress: Progress = lambda *_: None) -> Tuned:
    """Choose the settings that hit most.

    Args:
      name: of the controller.
      rate: hit rate with some settings, 0…1.
      progress: gets how many settings have been tried, and the best hit rate.
    """
    pattern = _Search(name, rate, progress)
    best = pattern.best()
    tried = tuple((tuning_at(name, at), found) for at, found in pattern.found.items())
    return Tuned(tuning_at(name, best), pattern.found[best], tried)


class _Search:
    """What has been tried: every setting once, within the budget."""

    def __init__(self, name: str, compute: Callable[[Tuning], float], progress: Progress) -> None:
        self.grids: Mapping[str, Grid] = GRIDS[name]
        self.name, self.compute, self.progress = name, compute, progress
        self.found: dict[Place, float] = {}

    def rate(self, at: Place) -> float:
        if at not in self.found:
            self.found[at] = self.compute(tuning_at(self.name, at))
            self.progress(len(self.found), max(self.found.values()))
        return self.found[at]

    def beside(self, at: Place, axis: int, by: int) -> Place | None:
        """Return the place beside another, or None beyond a natural bound."""
        index, last = at[axis] + by, tuple(self.grids.values())[axis].last
        return None if last is not None and index > last else (*at[:axis], index, *at[axis + 1 :])

    def neighbours(self, at: Place) -> list[Place]:
        places = (self.beside(at, axis, by) for axis in range(len(at)) for by in (-1, 1))
        return [each for each in places if each is not None]

    def affordable(self, there: Place, at: Place) -> bool:
        """Whether after another place the budget still does for the neighbours of either."""
        return all(len(self.found.keys() | {there, *self.neighbours(each)}) <= BUDGET for each in (there, at))

    def improved(self, at: Place, axis: int) -> Place:
        """Go along one setting while more shots hit, with doubled steps."""
        for direction in (1, -1):
            begun, step = at, direction
            while (there := self.beside(at, axis, step)) is not None and self.affordable(there, at):
                if self.rate(there) < self.rate(at) + LEAST_GAIN:
                    break
                at, step = there, max(-LONGEST_STEP, min(2 * step, LONGEST_STEP))
            if at != begun:
                break
        return at

    def best(self) -> Place:
        at, before = (0,) * len(self.grids), None
        self.rate(at)
        while before != at:
            before = at
            for axis in range(len(at)):
                at = self.improved(at, axis)
        for each in self.neighbours(at):
            self.rate(each)
        return at
