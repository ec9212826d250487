"""Tuning of the classical controllers on draws that no evaluation uses: a pattern search with expanding steps.

What a tracker should assume of its target, how far it should lead, and how smooth the commands of a preview should be,
depends on camera, link, gimbal and command limit. Every setting of a controller has a grid without ends, and settings
are compared on the same engagements with the same dispersion draws (common random numbers). From a start the search
tries the neighbours on the grid of one setting after the other, goes on with doubled steps in a direction in which more
shots hit (Hooke and Jeeves 1961), and ends where no neighbour hits more: so both neighbours of each chosen value have
been tried, and none is at an edge of what was.
"""

from __future__ import annotations  # so that help() names the types, rather than what they stand for

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from archerfish.compiled import has_jax
from archerfish.controllers.registry import make_controller
from archerfish.controllers.tuning import GRIDS, Tuning, TuningLike, entry, keep, kept, tuning_at
from archerfish.errors import InputError, one_line
from archerfish.evaluation.contenders import Contender
from archerfish.evaluation.draws import draw
from archerfish.evaluation.run import count
from archerfish.reports import progress
from archerfish.robot import Robot, RobotLike
from archerfish.simulation.world import make_world
from archerfish.task import Task, TaskLike

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


def tune(controller: str, robot: RobotLike = None, task: TaskLike = "any") -> Tuning:
    """Return the settings of a controller for a robot and a task: those that are kept, else searched for and kept.

    They are kept in the robot's folder, tuning.json; those of a robot without folder in the user's cache, and those of
    the paper's robot and targets come with Archerfish.

    Args:
      controller: one of `GRIDS`.
      robot: in whose simulator the controller is tuned; the paper's if not given.
      task: whose targets are engaged, or its name or TOML file; on the stream "tuning", that no evaluation has.

    Raises:
      InputError: if nothing is tuned of such a controller, the world can't be built, or what is kept can't be read.
    """
    if not isinstance(controller, str) or controller not in GRIDS:
        expected, given = ", ".join(GRIDS), one_line(repr(controller))[:100]
        raise InputError(f"tune: controller must be one of {expected}, got {given}; other controllers are not tuned")
    robot, task = Robot.of(robot), Task.of(task)
    tuning = kept(controller, robot, task)
    if tuning is None:
        begun = entry(controller, robot, task)
        note = f"{'compiling; ' * has_jax()}--tuning start does without"
        with progress.bar("tuning", BUDGET, "settings", note) as advance:

            def report(tried: int, best: float) -> None:
                advance(tried, f"{controller}, best {100 * best:.1f} %")

            found = search(controller, rates(controller, robot, task), report)
            report(BUDGET, found.hit_rate)
        tuning = found.tuning
        keep(begun.replace(tuning=tuning, hit_rate=found.hit_rate, tried=len(found.tried)), robot)
    return tuning


def settings(contenders: Sequence[Contender], tuning: TuningLike, robot: Robot, task: Task) -> dict[str, Tuning]:
    """Return the settings of all controllers that are tuned, by the names that results give them.

    Args:
      contenders: that are to shoot.
      tuning: as `evaluate` takes it; a controller that a mapping doesn't name has the settings that are kept.
      robot: its records.
      task: of any lengths.

    Raises:
      InputError: if it is nothing of that, or names another controller.
    """
    names = {contender.name: str(contender.given) for contender in contenders if contender.is_tuned}
    if isinstance(tuning, Tuning) and not names:
        raise InputError(f"tuning: there is none of {contenders[0].name}, only of {', '.join(GRIDS)}; leave it out")
    given = dict.fromkeys(names, tuning) if isinstance(tuning, Tuning) else tuning
    known = {*names, *names.values()}
    if not isinstance(given, Mapping):
        if given not in ("kept", "start"):
            expected = '"kept", "start", a Tuning, or a mapping from names of controllers to one'
            raise InputError(f"tuning: expected {expected}, got {one_line(repr(tuning))[:100]}; give one of these")
        if given == "start":
            return {name: tuning_at(controller) for name, controller in names.items()}
        return {name: tune(controller, robot, task) for name, controller in names.items()}
    if not all(name in known and isinstance(value, Tuning) for name, value in given.items()):
        expected = f"a Tuning for {', '.join(names) or 'no controller here'}"
        raise InputError(f"tuning: expected {expected}, got {one_line(repr(given))[:100]}; correct it")
    return {name: given.get(name) or given.get(own) or tune(own, robot, task) for name, own in names.items()}


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
        total = 0.0
        for part, drawn in parts:
            controller = make_controller(name, robot, part, tuning)
            total += float(count(world, controller, *drawn).hit.mean())
        return total / len(parts)

    return rate


def search(name: str, rate: Callable[[Tuning], float], progress: Progress = lambda *_: None) -> Tuned:
    """Choose the settings that hit most.

    Args:
      name: of the controller.
      rate: hit rate with some settings, 0…1.
      progress: gets how many settings have been tried, and the best hit rate.
    """
    grids, found = tuple(GRIDS[name].values()), dict[Place, float]()

    def hit_rate(at: Place) -> float:
        if at not in found:
            found[at] = rate(tuning_at(name, at))
            progress(len(found), max(found.values()))
        return found[at]

    def beside(at: Place, axis: int, by: int) -> Place | None:
        """Return the place beside another, or None beyond a natural bound."""
        index, last = at[axis] + by, grids[axis].last
        return None if last is not None and index > last else (*at[:axis], index, *at[axis + 1 :])

    def neighbours(at: Place) -> list[Place]:
        places = (beside(at, axis, by) for axis in range(len(at)) for by in (-1, 1))
        return [place for place in places if place is not None]

    def affordable(there: Place, at: Place) -> bool:
        """Whether after another place the budget still does for the neighbours of either."""
        return all(len(found.keys() | {there, *neighbours(place)}) <= BUDGET for place in (there, at))

    def improved(at: Place, axis: int) -> Place:
        """Go along one setting while more shots hit, with doubled steps."""
        for direction in (1, -1):
            begun, step = at, direction
            while (there := beside(at, axis, step)) is not None and affordable(there, at):
                if hit_rate(there) < hit_rate(at) + LEAST_GAIN:
                    break
                at, step = there, max(-LONGEST_STEP, min(2 * step, LONGEST_STEP))
            if at != begun:
                break
        return at

    best, before = (0,) * len(grids), None
    hit_rate(best)
    while before != best:
        before = best
        for axis in range(len(grids)):
            best = improved(best, axis)
    for place in neighbours(best):
        hit_rate(place)
    tried = tuple((tuning_at(name, at), share) for at, share in found.items())
    return Tuned(tuning_at(name, best), found[best], tried)
