"""`archerfish2 train`: a policy for a robot and a task."""

import json
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from archerfish2.errors import InputError
from archerfish2.learning.config import TrainConfig
from archerfish2.learning.run_folder import Begun, read_run
from archerfish2.learning.train import train, with_given
from archerfish2.robot import Robot
from archerfish2.task import Task


@dataclass(frozen=True)
class Train:
    """Train a policy in the simulator of a robot.

    - writes policy.safetensors, curve.svg (hits and reward), log.jsonl (every iteration) and run.json
    - Ctrl-C, SIGTERM or a crash lose nothing but the time since the last checkpoint: --resume FOLDER continues, to the
      same weights
    - an earlier training in the folder stays, as FOLDER.before, until the new one is finished

    Trainers: gradient follows the simulator's own gradient, which is faster and hits more; ppo is the paper's.
    Observations: paper (its six numbers), history, tracked (for a robot with sensing.json), multimodel (any target).
    Rewards: eq-8 (the paper's), hit, smooth-hit, or your own. What is not given follows robot and task.

    Examples:
      archerfish2 train my-robot
      archerfish2 train --task paper --seed 1
      archerfish2 train --task paper --observation paper --command-limit box
      archerfish2 train my-robot --reward ./mine.py:reward --set gradient.hidden=256 gradient.window=24
      archerfish2 train --resume my-robot/policy
    """

    robot: Annotated[tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="[ROBOT]", help_behavior_hint="")] = None
    """Folder of a robot's records; the paper's gimbal if not given."""
    task: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = "any"
    """What is shot at, as for evaluate."""
    command_limit: Annotated[
        Literal["gate", "box", "los-2deg"] | None,
        tyro.conf.arg(metavar="gate|box|los-2deg", help_behavior_hint="(default: the task's, gate)"),
    ] = None
    """Of angle ranges, rate and acceleration (gate), of angle ranges alone (box), or 2° ahead of the line of sight."""
    trainer: Annotated[Literal["gradient", "ppo"] | None, tyro.conf.arg(help_behavior_hint="")] = None
    """Analytic policy gradient, or PPO; gradient but for the observation paper."""
    observation: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME…", help_behavior_hint="")] = ()
    """A kind, then blocks of your own, ./FILE.py:NAME; multimodel, or for the paper's targets tracked or history."""
    reward: Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint="")] = None
    """What a shot is worth; ./FILE.py:NAME is your own."""
    steps: Annotated[int | None, tyro.conf.arg(metavar="N", help_behavior_hint="")] = None
    """Decisions to train for; 20 million, in about ten minutes on two idle processor cores, or for the paper's targets
    2 to 8. A million is enough for a first look."""
    set: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=VALUE…", help_behavior_hint="")] = ()
    """Any other setting, such as ppo.epochs=2 or checkpoint_every_s=10 (docs2/training.md lists them)."""
    seed: Annotated[int | None, tyro.conf.arg(metavar="N", help_behavior_hint="(default: 0)")] = None
    """Of everything random."""
    accept_unusable: Annotated[bool, tyro.conf.arg(help_behavior_hint="")] = False
    """Take parts of the robot that their identification found not usable."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER", help_behavior_hint="")] = None
    """Folder for the training; ROBOT/policy, or runs/train without a robot."""
    resume: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER", help_behavior_hint="")] = None
    """Continue the unfinished training of a folder. No other option is needed, but for code of your own: a --task,
    --observation or --reward that names some is given again, for code that only a file names is not run."""

    def run(self, _: str = "") -> None:
        """Train, print."""
        config = TrainConfig().replace(**self._settings())
        given: dict[str, Any] = {"config": config, "trainer": self.trainer, "seed": self.seed, "steps": self.steps}
        robot = Robot.load(self.robot, accept_unusable=self.accept_unusable) if self.robot else None
        task: Task | str = self.task
        if self.command_limit is not None:
            task = Task.load(self.task).replace(command_limit=self.command_limit)
        if self.resume is not None:
            out, begun = self.resume, read_run(self.resume)
            _announce(begun.robot, begun.task, begun.config, out)
            policy = train(robot, task, **given, reward=self.reward, out=self.out, resume=out)
        else:
            robot, task = Robot.of(robot), Task.of(task)
            out = self.out or (self.robot / "policy" if self.robot else Path("runs/train"))
            trainer = self.trainer or config.resolved(robot, task).trainer
            others = "ppo." if trainer == "gradient" else "gradient."
            if other := [setting for setting in self.set if setting.startswith(others)]:
                raise InputError(f"--set {other[0]} is not of the trainer {trainer}; leave it out, or name its trainer")
            _announce(robot, task, with_given(config, trainer, self.steps, self.reward).resolved(robot, task), out)
            policy = train(robot, task, **given, reward=self.reward, out=out)
        last: Any = policy.facts and policy.facts.training
        explored = ", with exploration" if last["config"]["trainer"] == "ppo" else ""
        print(  # noqa: T201
            f"{last['decisions']:,} decisions; of the latest shots {last['hit_share']:.1%} hit{explored}\n"
            f"policy: {out / 'policy.safetensors'}; curve: {out / 'curve.svg'}\n"
            f"next: {self._evaluation(out, read_run(out))}"
        )

    def _evaluation(self, out: Path, begun: Begun) -> str:
        """Return the command that evaluates the policy where it was trained."""
        task, own = begun.task, begun.config.names[1:]
        name = self.task if self.task != "any" else task.motion
        robot = self.robot or begun.robot.folder
        words = ["archerfish2", "evaluate", *([str(robot)] if robot else []), "--controllers", str(out), "kalman"]
        words += ["--task", name] if name != "any" else []
        words += ["--command-limit", task.command_limit] if task.command_limit != "gate" else []
        words += [] if all(verdict.usable for verdict in begun.robot.parts.values()) else ["--accept-unusable"]
        words += ["--blocks", *own] if own else []
        if self.task != "any" or task == Task(motion=name, command_limit=task.command_limit):
            return shlex.join(words)
        return f"archerfish2 evaluate with the file of the task {task.name}, which this folder doesn't name"

    def _settings(self) -> dict[str, Any]:
        settings: dict[str, Any] = {"observation": self.observation} if self.observation else {}
        for each in self.set:
            name, equals, text = each.partition("=")
            if not equals:
                raise InputError(f"--set takes NAME=VALUE, got {each}; write for instance gradient.hidden=256")
            try:
                value = json.loads(text)
            except ValueError:
                value = text
            part, dot, field = name.partition(".")
            if dot and not isinstance(settings.get(part, {}), dict):
                raise InputError(f"--set gives {part} and {name}; leave one out")
            if dot:
                settings.setdefault(part, {})[field] = value
            else:
                settings[name] = value
        return settings


def _announce(robot: Robot, task: Task, config: TrainConfig, out: Path) -> None:
    what = f"{config.trainer}, observation {config.kind}, {config.settings.steps:,} decisions"
    print(f"training for {robot.name}, task {task.name}: {what}; progress: {out / 'log.jsonl'}", flush=True)  # noqa: T201
