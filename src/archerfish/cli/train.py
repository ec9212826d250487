"""`archerfish train`: a policy for a gimbal, from its records."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from archerfish.cli.options import Folder, JsonFile
from archerfish.cli.progress import progress_bar, require_jax
from archerfish.cli.run_folder import run_folder
from archerfish.cli.setting import RobotOptions, SettingFiles, configuration, load_setting
from archerfish.learning.config import PpoConfig
from archerfish.learning.gradient_config import GradientConfig
from archerfish.records.errors import InputError

TARGETS = {"static": 1.0, "dynamic": 0.0, "both": 0.5}
"""Share of the targets that stand still in training."""


MOST_FRAMES = 64
"""More than a second of history at 20 ms; the observation grows with it."""


@dataclass(frozen=True)
class Train:
    """Train a policy in the simulator of a gimbal.

    Without files this is the paper's printed gimbal under our assumed conditions. Train with the command limit that the
    robot has: a policy is evaluated under the same one.

    Writes policy.json and policy.safetensors (the policy record, for evaluate), checkpoint.json, curve.svg, log.jsonl
    (metrics of each update) and config.json (all settings, seed and input hashes).

    Examples:
      archerfish train --seed 1 --out runs/train
      archerfish train --pitch pitch.json --yaw yaw.json --muzzle muzzle.json --robot infantry
      archerfish train --pitch pitch.json --yaw yaw.json --muzzle muzzle.json --sensing sensing.json --robot infantry
      archerfish train --target dynamic --command-limit box --ppo.steps 4000000
      archerfish train --trainer gradient --seed 1
    """

    setting: RobotOptions = field(default_factory=SettingFiles)
    """The robot."""
    target: Literal["static", "dynamic", "both"] = "both"
    """What moves: nothing, every target, or half of them."""
    observation: Annotated[
        Literal["history", "paper", "tracked"] | None,
        tyro.conf.arg(help_behavior_hint="(default: tracked with --sensing, else history)"),
    ] = None
    """What the policy sees: several frames (history), the paper's six numbers (paper), or what a tracker makes of old
    and noisy sights (tracked), which needs --sensing."""
    frames: int = 4
    """Frames that the history observation remembers."""
    command_limit: Literal["box", "gate", "los-2deg"] = "gate"
    """What the gimbal may be asked: angle ranges (box), also rate and acceleration (gate), or at most 2° ahead of the
    target."""
    trainer: Literal["ppo", "gradient"] = "ppo"
    """How: by trials, as the paper does (ppo), or along the simulator's own gradients (gradient), which is faster and
    sees no bonus for hits."""
    ppo: PpoConfig = field(default_factory=PpoConfig)
    """Settings of PPO."""
    gradient: GradientConfig = field(default_factory=GradientConfig)
    """Settings of training by gradients."""
    out: Folder = Path("runs/train")
    """Folder for the policy and everything about its training."""
    seed: int = 0
    """Of everything random in the training."""
    json: JsonFile = None
    """Also write what is printed to this file."""


def run_train(command: Train) -> dict[str, Any]:
    """Train, write the run folder, print a summary, and return what --json writes.

    Raises:
      InputError: if a record can't be used, a setting is out of range, or the training diverges.
    """
    observation = command.observation or ("history" if command.setting.sensing is None else "tracked")
    if observation == "history" and not 2 <= command.frames <= MOST_FRAMES:
        raise InputError(f"--frames must be from 2 (one frame shows no motion) to {MOST_FRAMES}, got {command.frames}")
    require_jax("train")
    from archerfish.cli.training_run import TrainingTask, run_task, write_run

    setting = load_setting(command.setting)
    task = TrainingTask(
        setting=setting,
        static_share=TARGETS[command.target],
        observation=observation,
        frames=command.frames,
        command_limit=command.command_limit,
        ppo=command.ppo,
        seed=command.seed,
        asymmetric=observation == "tracked",
        trainer=command.trainer,
        gradient=command.gradient,
    )
    with run_folder(command.out) as folder:
        with progress_bar("training", task.config.steps, "decisions") as advance:
            result = run_task(task, advance)
        write_run(folder, result, configuration(command, setting))
    summary = {
        "policy": str(command.out / "policy.json"),
        "steps": int(result.curve.steps[-1]),
        "seconds": round(result.seconds, 2),
        "mean_return": float(result.mean_return[-1]),
        "weights_sha256": result.weights_sha256,
    }
    print_training(summary)
    return summary


def print_training(summary: dict[str, Any]) -> None:
    """Print the outcome of a training."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title="training", show_header=False)
    for name, value in summary.items():
        table.add_row(name.replace("_", " "), f"{value:,.3f}" if isinstance(value, float) else str(value))
    Console().print(table)
