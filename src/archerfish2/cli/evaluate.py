"""`archerfish2 evaluate`: hit rates of controllers on the same engagements."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from archerfish2 import storage
from archerfish2.controllers.policy.policy import Policy
from archerfish2.controllers.registry import is_policy
from archerfish2.evaluation.evaluate import evaluate
from archerfish2.evaluation.results import Results
from archerfish2.robot import Robot
from archerfish2.task import Task


@dataclass(frozen=True)
class Evaluate:
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
      FOLDER, FILE.safetensors: a policy of archerfish2 train
      ./FILE.py:NAME, MODULE:NAME: your own (docs2/bring_your_own.md)

    Tasks:
      any           eight kinds of motion at 1–5 m, engagements of 1 s and 3 s
      still, parabola, pass, strafe, stop-and-go, sinusoid, circle, singer: one of these kinds
      paper         Tables II and III: static targets, and dynamic ones that follow eq (7)
      static, dynamic: one of these two
      FILE.toml, ./FILE.py:NAME: a task, a motion of your own (docs2/evaluation.md)

    Examples:
      archerfish2 evaluate --task paper --controllers kalman-paper kalman kalman-lq
      archerfish2 evaluate my-robot
      archerfish2 evaluate my-robot --task strafe --controllers kalman ./mine.py:Mine
    """

    robot: Annotated[tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="[ROBOT]", help_behavior_hint="")] = None
    """Folder of a robot's records; the paper's gimbal if not given."""
    controllers: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME…", help_behavior_hint="")] = ()
    """Who shoots; differences are to the first. If not given: ROBOT/policy if there is one, kalman, kalman-lq,
    oracle."""
    task: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = "any"
    """What is shot at."""
    command_limit: Annotated[
        Literal["gate", "box", "los-2deg"] | None,
        tyro.conf.arg(metavar="gate|box|los-2deg", help_behavior_hint="(default: the task's, gate)"),
    ] = None
    """Of angle ranges, rate and acceleration (gate), of angle ranges alone (box), or 2° ahead of the line of sight."""
    world: Annotated[str, tyro.conf.arg(metavar="./FILE.py:NAME", help_behavior_hint="")] = ""
    """A world of your own to shoot in; the robot's simulator if not given."""
    engagements: int = 500
    """Per cell, which is a kind of motion at a range."""
    seed: int = 0
    """Of engagements and dispersion."""
    untuned: Annotated[bool, tyro.conf.arg(help_behavior_hint="")] = False
    """Take classical controllers as they are before tuning."""
    accept_unusable: Annotated[bool, tyro.conf.arg(help_behavior_hint="")] = False
    """Take parts of the robot that their identification found not usable."""
    blocks: Annotated[tuple[str, ...], tyro.conf.arg(metavar="./FILE.py:NAME…", help_behavior_hint="")] = ()
    """Of the observation of a policy, that are your own: code that only a file names is not run."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER", help_behavior_hint="")] = None
    """Folder for the results; ROBOT/evaluation, or runs/evaluate without a robot."""
    overwrite: Annotated[bool, tyro.conf.arg(help_behavior_hint="")] = False
    """Replace files in that folder that this command did not write."""

    def run(self, options: str = "") -> None:
        """Evaluate, write, print; `options` are as typed, for run.json."""
        robot = Robot.of(self.robot, accept_unusable=self.accept_unusable)
        task = Task.of(self.task)
        if self.command_limit is not None:
            task = task.replace(command_limit=self.command_limit)
        out = self.out or (self.robot / "evaluation" if self.robot else Path("runs/evaluate"))
        inputs = [Path(each) for each in (self.task, *(each.rpartition(":")[0] for each in self.controllers))]
        controllers: Any = self.controllers or (*self._own_policy(), "kalman", "kalman-lq", "oracle")
        if self.blocks:
            controllers = [Policy.load(each, self.blocks) if is_policy(each) else each for each in controllers]
        names, facts = ("results.json", "report.html"), {"options": options}
        with storage.output_folder(out, "evaluate", inputs, self.overwrite, facts, names) as folder:
            results: Results = evaluate(
                controllers,
                robot,
                task,
                world=self.world or None,
                engagements=self.engagements,
                seed=self.seed,
                tuned=not self.untuned,
            )
            results.save(folder)
            results.report().write_page(folder / "report.html")
        took = ", ".join(f"{stage} {seconds:.0f} s" for stage, seconds in results.durations.items())
        print(f"{results}\n\n{took}\nopen {out / 'report.html'}; every count is in {out / 'results.json'}")  # noqa: T201

    def _own_policy(self) -> list[str]:
        """Return the policy of the robot's folder, none without; say so of one that is not finished."""
        folder = self.robot and self.robot / "policy"
        if folder is None or not is_policy(folder):
            return []
        if (folder / "policy.safetensors").is_file():
            return [str(folder)]
        left_out = f"{folder} is not finished and left out; continue it: archerfish2 train --resume {folder}"
        print(left_out, file=sys.stderr)  # noqa: T201
        return []
