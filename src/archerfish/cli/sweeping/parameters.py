"""What a sweep may vary, by name: settings of the training, and the world that is trained and shot in."""

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, get_type_hints

from archerfish.cli.setting import Setting, SettingFiles, load_setting
from archerfish.cli.train import MOST_FRAMES
from archerfish.cli.training_run import REWARDS, TRAINERS, TrainingTask, sees_truth
from archerfish.learning.config import PpoConfig
from archerfish.learning.gradient_config import GradientConfig
from archerfish.records.errors import InputError
from archerfish.sensing.observation import ACTION_SCALES
from archerfish.simulation.scenario import TARGETS

Value = bool | int | float | str

PAPER = "paper"
"""The value of `records` that stands for the paper's gimbal."""
MOTION = ("max_lateral_speed", "max_lateral_offset", "armor_height", "parabola_curvature", "parabola_rise")
"""Conditions of the targets' motion that may be varied."""


@dataclass(frozen=True)
class Parameter:
    """Something that a sweep may vary."""

    name: str
    """As typed."""
    kind: type
    """bool, int, float or str."""
    choices: tuple[str, ...] = ()
    """All values there are, if they are words."""
    world: bool = False
    """Whether it changes what is shot at or with: hit rates in different worlds don't compare."""
    positive: bool = False
    """Whether it must be above zero; what else is out of range the settings of a training say themselves."""


def _known() -> dict[str, Parameter]:
    found = []
    for prefix, config in (("ppo", PpoConfig), ("gradient", GradientConfig)):
        hints = get_type_hints(config)
        # How many shards there are is a matter of the machine.
        names = [each.name for each in fields(config) if each.name != "shards"]
        found += [Parameter(f"{prefix}.{_dashed(name)}", hints[name]) for name in names]
    found += [
        Parameter("trainer", str, tuple(TRAINERS)),
        Parameter("target", str, tuple(TARGETS)),
        Parameter("observation", str, tuple(REWARDS["ppo"])),
        Parameter("frames", int),
        Parameter("records", str, world=True),
        Parameter("command-limit", str, tuple(ACTION_SCALES), world=True),
    ]
    found += [
        Parameter(f"motion.{_dashed(name)}", float, world=True, positive=name != "armor_height") for name in MOTION
    ]
    return {each.name: each for each in found}


def _dashed(name: str) -> str:
    return name.replace("_", "-")


PARAMETERS = _known()
"""Name → parameter."""


def find_parameter(name: str) -> Parameter:
    """Return a parameter by its name, underscores or dashes.

    Raises:
      InputError: naming all that there are.
    """
    wanted = _dashed(name.strip())
    if wanted in PARAMETERS:
        return PARAMETERS[wanted]
    if wanted in ("seed", "seeds"):
        raise InputError("--vary takes no seeds; say for instance --seeds 0 1 2")
    near = difflib.get_close_matches(wanted, PARAMETERS, 1)
    meant = f"; perhaps you meant {near[0]}" if near else ""
    raise InputError(f"--vary: no parameter {name!r}, the parameters are {', '.join(PARAMETERS)}{meant}")


@dataclass(frozen=True)
class Base:
    """What every trial has in common, but for what is varied."""

    setting: Setting
    """The robot."""
    target: str
    """Which targets move."""
    observation: str | None
    """What the policy sees; None where the setting tells."""
    frames: int
    """Frames that a history observation remembers."""
    command_limit: str
    """What the gimbal may be asked."""
    trainer: str
    """One of `training_run.TRAINERS`."""
    ppo: PpoConfig
    """Settings of PPO."""
    gradient: GradientConfig
    """Settings of training by gradients."""


def load_records(folder: str, accept_unusable: bool) -> Setting:
    """Read the records in a folder: pitch.json and yaw.json, and muzzle.json, sensing.json and limits.json if there.

    Args:
      folder: its name is that of the robot; "paper" stands for the paper's gimbal.
      accept_unusable: as in `SettingFiles`.

    Raises:
      InputError: if a record can't be used.
    """
    if folder == PAPER:
        return load_setting(SettingFiles())
    path = Path(folder)
    optional: dict[str, Any] = {name: path / f"{name}.json" for name in ("muzzle", "sensing", "limits")}
    return load_setting(
        SettingFiles(
            pitch=path / "pitch.json",
            yaw=path / "yaw.json",
            **{name: file for name, file in optional.items() if file.exists()},
            accept_unusable=accept_unusable,
            robot=path.resolve().name,
        )
    )


def make_task(base: Base, values: Mapping[str, Value], seed: int, settings: Mapping[str, Setting]) -> TrainingTask:
    """Make the training of one trial.

    Args:
      base: what is not varied.
      values: name of a parameter → its value.
      seed: of the training.
      settings: value of `records` → what was read.

    Raises:
      InputError: if the values don't go together.
    """
    ppo, gradient, motion = (_below(prefix, values) for prefix in ("ppo.", "gradient.", "motion."))
    chosen: dict[str, Any] = {name: value for name, value in values.items() if "." not in name}
    setting = settings[chosen["records"]] if "records" in chosen else base.setting
    # replace() runs the checks of the settings.
    setting = replace(setting, conditions=replace(setting.conditions, **motion))
    asked = chosen.get("observation", base.observation)
    observation = asked or ("history" if setting.sensing is None else "tracked")
    frames = chosen.get("frames", base.frames)
    if observation == "history" and not 2 <= frames <= MOST_FRAMES:
        raise InputError(f"frames must be from 2 (one frame shows no motion) to {MOST_FRAMES}, got {frames}")
    if observation == "tracked" and setting.sensing is None:
        raise InputError("the tracked observation needs a sensing record; give --sensing, or --observation history")
    trainer = chosen.get("trainer", base.trainer)
    return TrainingTask(
        setting=setting,
        static_share=TARGETS[chosen.get("target", base.target)],
        observation=observation,
        frames=frames,
        command_limit=chosen.get("command-limit", base.command_limit),
        ppo=replace(base.ppo, **ppo),
        seed=seed,
        asymmetric=sees_truth(trainer, observation),
        trainer=trainer,
        gradient=replace(base.gradient, **gradient),
    )


def _below(prefix: str, values: Mapping[str, Value]) -> dict[str, Any]:
    """Return the values whose names begin so, by the names of their fields."""
    return {
        name.removeprefix(prefix).replace("-", "_"): value for name, value in values.items() if name.startswith(prefix)
    }


def world_name(base: Base, values: Mapping[str, Value], settings: Mapping[str, Setting]) -> str:
    """Name the world of a trial: setting, command limit, and what else of it is varied; arguments as in `make_task`."""
    setting = settings[str(values["records"])] if "records" in values else base.setting
    varied = [f"{name.partition('.')[2]} {value:g}" for name, value in values.items() if name.startswith("motion.")]
    return ", ".join([setting.name, str(values.get("command-limit", base.command_limit)), *varied])
