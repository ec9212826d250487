"""`archerfish evaluate`: hit rates of controllers on the same engagements."""

import hashlib
import json
import re
import shlex
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from archerfish.cli.options import Ending, ForRobot, Writes, assigned, shown
from archerfish.controllers.registry import is_policy, load_controller
from archerfish.controllers.tuning import GRIDS, TuningLike
from archerfish.evaluation.evaluate import USUAL, evaluate
from archerfish.evaluation.tuning_search import tune
from archerfish.plugins import names_code
from archerfish.records.json_files import plain
from archerfish.robot import Robot
from archerfish.task import Task


@dataclass(frozen=True)
class Evaluate(Writes, ForRobot):
    """Count the hits of controllers on the same engagements with the same dispersion draws.

    - prints hit rates in % with 95 % intervals over engagements, and paired differences to the first
    - writes results.json (every count), report.html (tables and figures) and run.json
    - tunes classical controllers first, on draws that no evaluation has; what was found is kept

    Controllers:
      kalman        Kalman filter; the intercept's angles are commanded
      kalman-lq     the same filter; commands through the gimbal's model (preview LQ)
      imm-lq        interacting multiple models, preview LQ
      parabola-lq   has the motion rule of eq (7), preview LQ
      no-lead       aims where the target is seen, preview LQ
      oracle        has the target's path in advance
      kalman-paper  kalman as the paper's figures calibrate it; the paper's robot alone
      perfect       perfect aim: what dispersion alone leaves
      FOLDER, FILE.safetensors: a policy of archerfish train
      ./FILE.py:NAME, MODULE:NAME: your own (docs/bring_your_own.md)

    Tasks:
      any           eight kinds of motion at 1–5 m, engagements of 1 s and 3 s
      still, parabola, pass, strafe, stop-and-go, sinusoid, circle, singer: one of these kinds
      paper         Tables II and III: static targets, and dynamic ones that follow eq (7)
      static, dynamic: one of these two
      FILE.toml, ./FILE.py:NAME: a task, a motion of your own (docs/evaluation.md)

    Examples:
      archerfish evaluate --task paper --controllers kalman-paper kalman kalman-lq
      archerfish evaluate my-robot
      archerfish evaluate my-robot --task strafe --controllers kalman ./mine.py:Mine
      archerfish evaluate my-robot --task ./mine.py:Zigzag --set 'lengths_s=[1, 3]' --tuning any
    """

    controllers: Annotated[tuple[str, ...], shown("NAME…")] = ()
    """Who shoots; differences are to the first. If not given: ROBOT/policy if there is one, kalman, kalman-lq,
    oracle."""
    motion: Annotated[str, shown("./FILE.py:NAME")] = ""
    """A motion of your own in the place of the task's: code that only a file names is not run."""
    set: Annotated[tuple[str, ...], shown("NAME=VALUE…")] = ()
    """Fields of the task that are to be otherwise, such as max_speed_m_s=1 or 'lengths_s=[3]' (docs/evaluation.md)."""
    world: Annotated[str, shown("./FILE.py:NAME")] = ""
    """A world of your own to shoot in; the robot's simulator if not given."""
    engagements: int = 500
    """Per cell, which is a kind of motion at a range."""
    seed: int = 0
    """Of engagements and dispersion."""
    tuning: Annotated[str, tyro.conf.arg(metavar="kept|start|TASK")] = "kept"
    """Settings of classical controllers: those that are kept for robot and task, which are searched for where there are
    none; those where the search begins; or those for another task."""
    blocks: Annotated[tuple[str, ...], shown("./FILE.py:NAME…")] = ()
    """Of the observation of a policy, that are your own: code that only a file names is not run."""
    out: Annotated[Path | None, shown("FOLDER")] = None
    """Folder for the results; ROBOT/evaluation, or runs/evaluate without a robot, and in it one for each other task."""

    def run(self, options: str = "") -> Ending:
        """Evaluate, write; `options` are as typed, for run.json."""
        robot, task = Robot.of(self.robot, accept_unusable=self.accept_unusable), self._task()
        out = self.out or self._folder(task)
        controllers: Any = self.controllers or (*self.own_policy(), *USUAL)
        if self.blocks:
            controllers = [load_controller(name, self.blocks) if is_policy(name) else name for name in controllers]
        inputs = (self.task, *(name.rpartition(":")[0] for name in self.controllers))
        with self.written(out, "evaluate", options, inputs, ("results.json", "report.html")) as folder:
            results = evaluate(
                controllers,
                robot,
                task,
                world=self.world or None,
                engagements=self.engagements,
                seed=self.seed,
                tuning=self._tuning(controllers, robot, task),
            )
            results.save(folder)
            page = folder / "report.html"
            results.report.linked(page, [robot.folder / "robot.html"] if robot.folder else []).write_page(page)
        took = ", ".join(f"{stage} {seconds:.0f} s" for stage, seconds in results.durations.items())
        where = f"{took}\nopen {out / 'report.html'}; every count is in {out / 'results.json'}"
        words = [str(self.robot)] if self.folder else []
        words += ["--task", self.task] if self.task != "any" else []
        words += ["--controller", *own[:1]] if (own := [name for name in self.controllers if ":" in name]) else []
        return Ending(f"{results}", where, shlex.join(["archerfish", "view", *words]))

    def _task(self) -> Task:
        """Return the task with the fields that are otherwise."""
        task = Task.load(self.task, self.motion) if self.motion else Task.of(self.task)
        limit = {"command_limit": self.command_limit} if self.command_limit else {}
        return task.replace(**limit, **assigned(self.set))

    def _folder(self, task: Task) -> Path:
        """Return where results are written: for other than the usual conditions a folder that is named after them."""
        usual, changed = plain(Task(motion=task.motion)), [task.name] if task.name != "any" else []
        changed += [f"{name}={value}" for name, value in plain(task).items() if name != "name" and value != usual[name]]
        is_named = task.name != Task(motion=task.motion).name
        changed += [f"motion={task.motion.rpartition(':')[2]}"] if is_named else []
        changed += [self.world.rpartition(":")[2]] if self.world else []
        changed += [f"tuning={self.tuning}"] if self.tuning != "kept" else []
        name = "-".join(changed)
        plain_name = re.sub(r"[^\w.=-]+", "_", name).strip(".")[:80]
        if plain_name != name or names_code(task.motion) or self.world:  # others may have this name
            conditions = json.dumps([plain(task), self.world, self.tuning], sort_keys=True)
            plain_name += f"-{hashlib.sha256(conditions.encode()).hexdigest()[:8]}"
        folder = self.folder / "evaluation" if self.folder else Path("runs/evaluate")
        return folder / plain_name

    def _tuning(self, controllers: Iterable[Any], robot: Robot, task: Task) -> TuningLike:
        if self.tuning == "kept":
            return "kept"
        if self.tuning == "start":
            return "start"
        other = Task.load(self.tuning).replace(command_limit=task.command_limit)
        return {name: tune(name, robot, other) for name in controllers if isinstance(name, str) and name in GRIDS}
