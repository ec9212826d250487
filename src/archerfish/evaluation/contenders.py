"""Controllers as a verb is given them: each under the name that results give it, and made once for a length."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from archerfish.arrays import map_arrays
from archerfish.controllers.registry import ControllerLike, is_policy, load_controller, make_controller
from archerfish.controllers.tuning import GRIDS, Tuning
from archerfish.errors import InputError, one_line
from archerfish.evaluation.draws import draw
from archerfish.evaluation.results import Kind
from archerfish.plugins import find_plugin
from archerfish.protocols import Controller, World, check_decision
from archerfish.records.json_files import plain
from archerfish.robot import Robot
from archerfish.targets.mixture import MIXTURES
from archerfish.task import DRAWN, EQ_7, Task

PERFECT = "perfect"
"""Name of perfect aim, which only dispersion makes miss."""


class Contender(NamedTuple):
    """A controller under the name that results give it."""

    name: str  # contenders of one name differ in their seed
    given: Any  # a policy, one of `NAMES`, `PERFECT`, or what a user wrote: an object, class or function
    kind: Kind
    seed: int | None  # of a policy's training

    @property
    def is_tuned(self) -> bool:
        """Whether it has settings that are searched for."""
        return self.kind == "classical" and self.given in GRIDS

    def make(self, robot: Robot, task: Task, tuning: Tuning | None = None) -> Controller | None:
        """Make the controller for a robot and a task of one length; perfect aim has none.

        Args:
          robot: its records.
          task: of one length.
          tuning: where the search of the settings begins if not given.

        Raises:
          InputError: if it can't be made, or is a policy of another robot or decision period.
        """
        facts, records = getattr(self.given, "facts", None), robot.record_digests()
        if facts is not None and facts.observer.period_s != task.period_s:
            periods = f"{facts.observer.period_s:g} s, expected {task.period_s:g} s"
            raise InputError(f"{self.name} decides every {periods}; train again")
        if facts is not None and facts.robot not in ({}, records) and records == Robot.paper().record_digests():
            raise InputError(f"{self.name} was trained for another robot than {robot.name}; name that robot's folder")
        if self.kind in ("policy", "perfect"):
            return self.given if self.kind == "policy" else None
        return make_controller(self.given, robot, task, tuning)  # type: ignore[no-any-return]


def as_contenders(
    controllers: ControllerLike | Iterable[ControllerLike] | Mapping[str, ControllerLike],
) -> list[Contender]:
    """Return controllers under the names that results give them; equal names of one seed get -2, -3.

    Args:
      controllers: as `evaluate` takes them.

    Raises:
      InputError: if there is none, one can't be read, or a name can't be shown.
    """
    contenders: dict[tuple[str, int | None], Contender] = {}
    trainings: dict[str, Any] = {}
    for name, controller in _with_names(controllers):
        if not isinstance(name, str) or not 1 <= len(name) <= 1000:
            given = one_line(repr(name))[:100]
            raise InputError(f"controllers: a name must have 1…1000 characters, got {given}; choose another")
        given = load_controller(controller)
        seed = getattr(getattr(given, "facts", None), "seed", None)
        training, unused = _training(given), name
        for number in itertools.count(2):  # trainings that differ in more than their seed are not one controller
            if (unused, seed) not in contenders and trainings.get(unused, training) == training:
                break
            unused = f"{name}-{number}"
        trainings[unused] = training
        contenders[unused, seed] = Contender(unused, given, _kind(given), seed)
    if not contenders:
        raise InputError('controllers: there is none; give one, such as "kalman"')
    return list(contenders.values())


def _with_names(controllers: Any) -> Iterable[tuple[Any, Any]]:
    if isinstance(controllers, Mapping):
        return controllers.items()
    is_one = isinstance(controllers, str) or not isinstance(controllers, Iterable) or hasattr(controllers, "step")
    return [(_name(controller), controller) for controller in ((controllers,) if is_one else controllers)]


def _name(controller: Any) -> str:
    if is_policy(controller):
        path = Path(controller)
        return path.stem if path.suffix == ".safetensors" else path.name
    if isinstance(controller, str | Path):
        return str(controller).rpartition(":")[2]
    return "policy" if hasattr(controller, "facts") else str(getattr(controller, "__name__", type(controller).__name__))


def _training(given: Any) -> Any:
    """Return what trainings of one controller have in common, None of what is not trained."""
    facts = getattr(given, "facts", None)
    return facts and plain((facts.observer, facts.task, facts.robot, facts.training.get("config")))


def _kind(given: Any) -> Kind:
    if isinstance(given, str):
        return "perfect" if given == PERFECT else "classical"
    return "policy" if hasattr(given, "facts") else "user"


def prepared(contenders: Sequence[Contender], world: World, robot: Robot, task: Task) -> dict[int, Controller | None]:
    """Return by their places the controllers that are not tuned; policies and a user's own have decided once.

    Args:
      contenders: that are to shoot.
      world: where they are to shoot.
      robot: its records.
      task: of one length.

    Raises:
      InputError: if one can't be made, its code fails, or what it returns is no decision.
    """
    made: dict[int, Controller | None] = {}
    for place, contender in enumerate(contenders):
        if not contender.is_tuned:
            made[place] = contender.make(robot, task)
        if contender.kind == "perfect" and not hasattr(world, "shoot"):
            raise InputError(f"perfect aim needs a simulator with shoot(), {world.name} has none; leave it out")
    tried = [made[place] for place, contender in enumerate(contenders) if contender.kind in ("user", "policy")]
    if tried:
        engagement, normals = draw(task.cells(), 3, 0, "stopping", world.normals, world.plants)
        with find_plugin(world, "world").running():
            seen = map_arrays(np.asarray, world.see(world.begin(engagement, normals)))
        for controller in tried:
            needs_truth = getattr(controller, "needs_truth", False)
            check_decision(controller, seen, world.truth(engagement) if needs_truth else None)
    return made


def unlike_training(contender: Contender, robot: Robot, task: Task) -> str:
    """Say in one line in what the training of a policy was unlike an evaluation, "" if in nothing."""
    facts = getattr(contender.given, "facts", None)
    if facts is None:
        return ""
    was = {"limit": facts.task.command_limit, **facts.task.conditions()}
    now = {"limit": task.command_limit, **task.conditions()}
    covered = {"paper": EQ_7, **dict.fromkeys(MIXTURES, DRAWN)}.get(facts.task.motion, (facts.task.motion,))
    if task.motion not in covered:
        was, now = {"targets": facts.task.motion, **was}, {"targets": task.motion, **now}
    unlike = [f"{field} {was[field]} (here {now[field]})" for field in was if was[field] != now[field]]
    unlike += ["another robot's records"] if facts.robot not in ({}, robot.record_digests()) else []
    remedy = f"; task {facts.task.name} is that of its training" if facts.task.name != task.name else ""
    return f"{contender.name} was trained for {', '.join(unlike)}{remedy}." if unlike else ""
