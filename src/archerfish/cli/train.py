"""`archerfish train`: a policy for a gimbal, from its records."""

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from archerfish.cli.progress import progress_bar, require_jax
from archerfish.cli.setting import Setting, SettingFiles, load_setting
from archerfish.learning.config import PpoConfig
from archerfish.records import storage
from archerfish.records.errors import InputError
from archerfish.records.provenance import provenance

TARGETS = {"static": 1.0, "dynamic": 0.0, "both": 0.5}
"""Share of the targets that stand still in training."""


@dataclass(frozen=True)
class Train:
    """Train a policy in the simulator of a gimbal and write it as a policy record.

    Without files this is the paper's printed gimbal under our assumed conditions.
    """

    setting: SettingFiles = field(default_factory=SettingFiles)
    """The robot."""
    target: Literal["static", "dynamic", "both"] = "both"
    """What moves: nothing, every target, or half of them."""
    observation: Literal["history", "paper"] = "history"
    """What the policy sees: the last frames, or the paper's six numbers."""
    frames: int = 4
    """Frames that the history observation remembers."""
    command_limit: Literal["box", "gate", "los-2deg"] = "gate"
    """What the gimbal may be asked: angle ranges alone, also rate and acceleration, or at most 2° ahead of the target."""
    ppo: PpoConfig = field(default_factory=PpoConfig)
    """Settings of PPO."""
    out: Path = Path("runs/train")
    """Folder for policy.json (the policy record), checkpoint.json, curve.svg, log.jsonl and config.json."""
    seed: int = 0
    """Of everything random in the training."""
    json: Path | None = None
    """Also write what is printed to this file."""


def run_train(command: Train) -> dict[str, Any]:
    """Train, write the run folder, print a summary, and return what --json writes.

    Raises:
      InputError: if a record can't be used, a setting is out of range, or the training diverges.
    """
    require_jax("train")
    from archerfish.cli.training_run import TrainingTask, run_task, write_run  # noqa: PLC0415  needs JAX

    setting = load_setting(command.setting)
    storage.check_writable(command.out)
    task = TrainingTask(
        setting=setting,
        static_share=TARGETS[command.target],
        observation=command.observation,
        frames=command.frames,
        command_limit=command.command_limit,
        ppo=command.ppo,
        seed=command.seed,
    )
    with progress_bar("training", command.ppo.steps, "decisions") as advance:
        result = run_task(task, advance)
    write_run(command.out, result, configuration(command, setting))
    summary = {
        "policy": str(command.out / "policy.json"),
        "steps": int(result.curve.steps[-1]),
        "seconds": round(result.seconds, 2),
        "mean_return": float(result.mean_return[-1]),
        "weights_sha256": result.weights_sha256,
    }
    print_training(summary)
    return summary


def configuration(command: Any, setting: Setting) -> dict[str, Any]:
    """Return the resolved configuration of a command, as written into its run folder."""
    plain = {name: _plain(value) for name, value in asdict(command).items() if name not in ("json", "out")}
    return {**plain, "setting_name": setting.name, "provenance": provenance(command.seed, setting.inputs)}


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _plain(each) for name, each in value.items()}
    return str(value) if isinstance(value, Path) else value


def print_training(summary: dict[str, Any]) -> None:
    """Print the outcome of a training."""
    from rich.console import Console  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    table = Table(title="training", show_header=False)
    for name, value in summary.items():
        table.add_row(name.replace("_", " "), f"{value:,.3f}" if isinstance(value, float) else str(value))
    Console().print(table)


def check_known(kind: str, name: str, known: tuple[str, ...]) -> None:
    """Refuse an unknown name.

    Raises:
      InputError: naming what is known.
    """
    if name not in known:
        raise InputError(f"{kind} must be one of {', '.join(known)}, got {name!r}")
