"""Who shoots where: robots, tasks, worlds and controllers as they are given, made and tried before the work."""

import itertools
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from archerfish2.arrays import map_arrays
from archerfish2.controllers.policy.policy import Policy
from archerfish2.controllers.registry import NAMES, is_policy, make_controller
from archerfish2.controllers.tuning import GRIDS, Tuning, kept
from archerfish2.errors import InputError
from archerfish2.evaluation.draws import draw
from archerfish2.evaluation.published import conditions, is_paper
from archerfish2.evaluation.results import Kind, Label
from archerfish2.evaluation.tuning import BUDGET, tune
from archerfish2.plugins import find_plugin, is_plugin
from archerfish2.protocols import Controller, World, check_decision
from archerfish2.reports import progress
from archerfish2.robot import Robot
from archerfish2.targets.mixture import MIXTURES
from archerfish2.task import DRAWN, EQ_7, Suite, Task

PERFECT = "perfect"
"""Name of perfect aim, which only dispersion makes miss."""


class Contender(NamedTuple):
    """A controller under the name that results give it."""

    name: str  # its own
    controller: Controller | None  # for the length that is shot; None: perfect aim
    kind: Kind
    seed: int | None = None  # of a policy's training
    word: str = ""  # by which it was given, of those here
    is_papers: bool = False  # whether a policy sees what the paper's sees, and was trained as that was


def named_controllers(controllers: Any) -> list[tuple[str, Any]]:
    """Return controllers with the names that results give them; equal names of one seed get -2, -3.

    Args:
      controllers: as `evaluate` takes them.

    Raises:
      InputError: if there is none.
    """
    if isinstance(controllers, str) or not isinstance(controllers, Iterable) or hasattr(controllers, "step"):
        controllers = (controllers,)
    pairs: Iterable[tuple[str, Any]]
    pairs = controllers.items() if isinstance(controllers, Mapping) else ((_name(each), each) for each in controllers)
    named: dict[tuple[str, int | None], Any] = {}
    for name, value in pairs:
        if is_policy(value):
            value = Policy.load(value)
        elif isinstance(value, str) and is_plugin(value, "controller"):
            value = find_plugin(value, "controller").value  # once: the file may be edited during the evaluation
        seed = getattr(getattr(value, "facts", None), "seed", None)
        names = itertools.chain([name], (f"{name}-{number}" for number in itertools.count(2)))
        named[next(each for each in names if (each, seed) not in named), seed] = value
    if not named:
        raise InputError('controllers: there is none; give one, such as "kalman"')
    return [(name, value) for (name, _), value in named.items()]


def _name(controller: Any) -> str:
    if is_policy(controller):
        return Path(controller).stem
    if isinstance(controller, str):
        return controller.rpartition(":")[2]
    return "policy" if hasattr(controller, "facts") else getattr(controller, "__name__", type(controller).__name__)


def make_contender(name: str, value: Any, robot: Robot, task: Task, tuning: Mapping[str, Tuning]) -> Contender:
    """Make a controller for a robot and a task of one length.

    Args:
      name: that results give it.
      value: as `evaluate` takes it.
      robot: its records.
      task: of one length.
      tuning: by name; where its search begins for a controller that is not among them.

    Raises:
      InputError: if it can't be made.
    """
    if hasattr(value, "facts"):
        period = value.facts.observer.period_s
        if period != task.period_s:
            raise InputError(f"{name} decides every {period:g} s, expected {task.period_s:g} s; train again")
        if value.facts.robot not in ({}, own := robot.record_digests()) and own == Robot.paper().record_digests():
            raise InputError(f"{name} was trained for another robot than {robot.name}; name that robot's folder")
        facts = value.facts
        is_papers = facts.observer.observation == ("paper",) and facts.task.motion == "paper"
        is_papers = is_papers and is_paper(facts.robot, facts.task)
        return Contender(name, value, "policy", facts.seed, is_papers=is_papers)
    word = value if isinstance(value, str) else ""
    if word == PERFECT:
        return Contender(name, None, "perfect")
    made = make_controller(value, robot, task, tuning.get(word))
    return Contender(name, made, "classical" if word in NAMES else "user", word=word)


def unlike_training(name: str, value: Any, robot: Robot, task: Task) -> str:
    """Say in one line in what the training of a policy was unlike an evaluation, "" if in nothing."""
    facts = getattr(value, "facts", None)
    if facts is None:
        return ""
    was = {"limit": facts.task.command_limit, **conditions(facts.task)}
    now = {"limit": task.command_limit, **conditions(task)}
    covered = {"paper": EQ_7, **dict.fromkeys(MIXTURES, DRAWN)}.get(facts.task.motion, (facts.task.motion,))
    if task.motion not in covered:
        was, now = {"targets": facts.task.motion, **was}, {"targets": task.motion, **now}
    unlike = [f"{field} {was[field]} (here {now[field]})" for field in was if was[field] != now[field]]
    unlike += ["another robot's records"] if facts.robot not in ({}, robot.record_digests()) else []
    return f"{name} was trained for {', '.join(unlike)}." if unlike else ""


def label(suite: Suite, contender: Contender, world: World, task: Task) -> dict[str, Any]:
    """Return what a `Label` has of a controller in a cell."""
    facts = {name: getattr(suite, name) for name in ("motion", "range_m", "length_s")}
    facts |= {"world": world.name, "command_limit": task.command_limit}
    return facts | {"controller": contender.name, "seed": contender.seed}


def check_controllers(named: list[tuple[str, Any]], world: World, robot: Robot, task: Task) -> None:
    """Refuse unknown names before anything takes long, and let a user's controllers and policies decide once.

    Args:
      named: names, and controllers as `evaluate` takes them.
      world: where they are to shoot.
      robot: its records.
      task: of any lengths, for each of which all are made.

    Raises:
      InputError: if one can't be made or shown in results, its code fails, or what it returns is no decision.
    """
    for part in (task.replace(lengths_s=(length,)) for length in task.lengths):
        cells = part.cells()
        engagement, normals = draw(cells, 3, 0, "stopping", world.normals, world.plants)
        with find_plugin(world, "world").running():
            seen = map_arrays(np.asarray, world.see(world.begin(engagement, normals)))
        for each in [make_contender(name, value, robot, part, {}) for name, value in named]:
            Label(**label(cells[0], each, world, part))
            if each.controller is None and not hasattr(world, "shoot"):
                raise InputError(f"perfect aim needs a simulator with shoot(), {world.name} has none; leave it out")
            if each.kind in ("user", "policy"):
                truth = world.truth(engagement) if getattr(each.controller, "needs_truth", False) else None
                check_decision(each.controller, seen, truth)


def tune_controllers(named: list[tuple[str, Any]], robot: Robot, task: Task) -> dict[str, Tuning]:
    """Return the settings of all controllers that are tuned, by name; arguments as of `check_controllers`."""
    names = [value for value in dict.fromkeys(each for _, each in named if isinstance(each, str)) if value in GRIDS]
    tuning = {name: found for name in names if (found := kept(name, robot, task)) is not None}
    missing = [name for name in names if name not in tuning]
    if not missing:
        return tuning
    with progress.bar("tuning", BUDGET * len(missing), "settings") as advance:
        for place, name in enumerate(missing):

            def report(tried: int, best: float, before: int = BUDGET * place, name: str = name) -> None:
                advance(before + tried, f"{name}, best {100 * best:.1f} %" if tried else name)

            report(0, 0.0)
            tuning[name] = tune(name, robot, task, report)
    return tuning
