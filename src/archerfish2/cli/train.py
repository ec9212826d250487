"""`archerfish2 train`: a policy for a robot and a task."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from archerfish2.errors import InputError
from archerfish2.evaluation.contenders import load
from archerfish2.learning.config import TrainConfig
from archerfish2.learning.train import train


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
    """Decisions to train for; 20 million, or for the paper's targets 2 to 8."""
    set: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=VALUE…", help_behavior_hint="")] = ()
    """Any other setting, such as ppo.epochs=2 or checkpoint_every_s=10 (docs2/training.md lists them)."""
    seed: int = 0
    """Of everything random."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER", help_behavior_hint="")] = None
    """Folder for the training; ROBOT/policy, or runs/train without a robot."""
    resume: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER", help_behavior_hint="")] = None
    """Continue the unfinished training of a folder. No other option is needed, but for code of your own: a --task,
    --observation or --reward that names some is given again, for code that only a file names is not run."""

    def run(self, _: str = "") -> None:
        """Train, print."""
        config = TrainConfig().replace(**self._settings())
        if self.resume is not None:
            names = ("robot", "command_limit", "trainer", "steps", "set", "seed", "out")
            if ignored := [name for name in names if getattr(self, name)]:
                raise InputError(f"--resume continues with the training's own settings; leave {', '.join(ignored)} out")
            policy, out = train(None, self.task, config=config, reward=self.reward, resume=self.resume), self.resume
        else:
            robot, task = load(self.robot, self.task)
            task = task if self.command_limit is None else task.replace(command_limit=self.command_limit)
            out = self.out or (self.robot / "policy" if self.robot else Path("runs/train"))
            trainer = self.trainer or config.resolved(robot, task).trainer
            if other := [
                each for each in self.set if each.startswith("ppo." if trainer == "gradient" else "gradient.")
            ]:
                raise InputError(f"--set {other[0]} is not of the trainer {trainer}; leave it out, or name its trainer")
            given: dict[str, Any] = {"trainer": self.trainer, "steps": self.steps, "reward": self.reward}
            policy = train(robot, task, config=config, seed=self.seed, out=out, **given)
        last: Any = policy.facts and policy.facts.training
        explored = ", with exploration" if last["config"]["trainer"] == "ppo" else ""
        place = "[ROBOT] " if self.resume else f"{self.robot} " if self.robot else ""
        own = "".join(f" --blocks {each}" for each in policy.facts.observer.observation[1:]) if policy.facts else ""
        print(  # noqa: T201
            f"{last['decisions']:,} decisions; of the latest shots {last['hit_share']:.1%} hit{explored}\n"
            f"policy: {out / 'policy.safetensors'}; curve: {out / 'curve.svg'}\n"
            f"next: archerfish2 evaluate {place}--controllers {out} kalman{own}"
        )

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
