"""`archerfish train`: a policy for a robot and a task."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from archerfish.cli.options import Ending, ForRobot, assigned, shown
from archerfish.controllers.policy.policy import Policy
from archerfish.errors import InputError
from archerfish.learning.config import TrainConfig
from archerfish.learning.run_folder import Begun, read_run
from archerfish.learning.train import resume, train, with_given
from archerfish.robot import Robot
from archerfish.task import Task


@dataclass(frozen=True)
class Train(ForRobot):
    """Train a policy in the simulator of a robot.

    - writes policy.safetensors, curve.svg (hits and reward), log.jsonl (every iteration) and run.json
    - Ctrl-C, SIGTERM or a crash lose nothing but the time since the last checkpoint: --resume FOLDER continues, to the
      same weights
    - an earlier training in the folder stays, as FOLDER.before, until the new one is finished

    Trainers: gradient follows the simulator's own gradient, which is faster and hits more; ppo is the paper's.
    Observations: paper (its six numbers), history, tracked (for a robot with sensing.json), multimodel (any target).
    Rewards: eq-8 (the paper's), hit, smooth-hit, or your own. What is not given follows robot and task.

    Examples:
      archerfish train my-robot
      archerfish train --task paper --seed 1
      archerfish train --task paper --observation paper --command-limit box
      archerfish train my-robot --reward ./mine.py:reward --set gradient.hidden=256 gradient.window=24
      archerfish train --resume my-robot/policy
    """

    trainer: Annotated[Literal["gradient", "ppo"] | None, shown("gradient|ppo")] = None
    """Analytic policy gradient, or PPO; gradient but for the observation paper."""
    observation: Annotated[tuple[str, ...], shown("NAME…")] = ()
    """A kind, then blocks of your own, ./FILE.py:NAME; multimodel, or for the paper's targets tracked or history."""
    reward: Annotated[str | None, shown("NAME")] = None
    """What a shot is worth; ./FILE.py:NAME is your own."""
    steps: Annotated[int | None, shown("N")] = None
    """Decisions to train for, rounded to whole iterations; 18 million, in about ten minutes on two idle
    processor cores, or for the paper's targets 2 to 8. A million is enough for a first look."""
    set: Annotated[tuple[str, ...], shown("NAME=VALUE…")] = ()
    """Any other setting, such as ppo.epochs=2 or checkpoint_every_s=10 (docs/training.md lists them)."""
    seed: Annotated[int | None, shown("N", "(default: 0)")] = None
    """Of everything random."""
    out: Annotated[Path | None, shown("FOLDER")] = None
    """Folder for the training; ROBOT/policy, or runs/train without a robot."""
    resume: Annotated[Path | None, shown("FOLDER")] = None
    """Continue the unfinished training of a folder. No other option is needed, but for code of your own: a --task,
    --observation or --reward that names some is given again, for code that only a file names is not run."""

    def run(self, _: str = "") -> Ending:
        """Train."""
        out = self.resume or self.out or (self.folder / "policy" if self.folder else Path("runs/train"))
        policy = self._resumed(out) if self.resume else self._trained(out)
        last: Any = policy.facts and policy.facts.training
        explored = ", with exploration" if last["config"]["trainer"] == "ppo" else ""
        found = f"{last['decisions']:,} decisions; of the latest shots {last['hit_share']:.1%} hit{explored}"
        where = f"open {out / 'curve.svg'}; the policy is {out / 'policy.safetensors'}"
        return Ending(found, where, self._evaluation(out, read_run(out)))

    def _trained(self, out: Path) -> Policy:
        robot, task = self.robot_and_task()
        settings = assigned(self.set) | ({"observation": self.observation} if self.observation else {})
        config = with_given(TrainConfig.of(settings), self.trainer, self.steps, self.reward).resolved(robot, task)
        others = "ppo." if config.trainer == "gradient" else "gradient."
        if other := [setting for setting in self.set if setting.startswith(others)]:
            raise InputError(
                f"--set {other[0]} is not of the trainer {config.trainer}; leave it out, or name --trainer"
            )
        _announce(robot, task, config, out)
        return train(robot, task, config=config, seed=self.seed or 0, out=out)

    def _resumed(self, out: Path) -> Policy:
        begun, usual = read_run(out), Train()
        given = {name for name, value in vars(self).items() if value != getattr(usual, name)}
        if ignored := sorted(given - {"resume", "task", "observation", "reward"}):
            remedy = f"leave --{ignored[0].replace('_', '-')} out, or begin another training"
            raise InputError(f"--resume {out} continues with the training's own settings; {remedy}")
        _announce(begun.robot, begun.task, begun.config, out)
        blocks = self.observation[1:] if self.observation[:1] == (begun.config.kind,) else self.observation
        return resume(out, task=self.task if "task" in given else None, reward=self.reward, blocks=blocks)

    def _evaluation(self, out: Path, begun: Begun) -> str:
        """Return the command that evaluates the policy where it was trained."""
        task, own = begun.task, begun.config.names[1:]
        name = self.task if self.task != "any" else task.motion
        robot = self.folder or begun.robot.folder
        words = ["archerfish", "evaluate", *([str(robot)] if robot else []), "--controllers", str(out), "kalman"]
        words += ["--task", name] if name != "any" else []
        words += ["--command-limit", task.command_limit] if task.command_limit != "gate" else []
        words += [] if all(verdict.usable for verdict in begun.robot.parts.values()) else ["--accept-unusable"]
        words += ["--blocks", *own] if own else []
        if self.task != "any" or task == Task(motion=name, command_limit=task.command_limit):
            return shlex.join(words)
        return f"archerfish evaluate with the file of the task {task.name}, which this folder doesn't name"


def _announce(robot: Robot, task: Task, config: TrainConfig, out: Path) -> None:
    what = f"{config.trainer}, observation {config.kind}, {config.settings.trained:,} decisions"
    print(f"training for {robot.name}, task {task.name}: {what}; progress: {out / 'log.jsonl'}", flush=True)  # noqa: T201
