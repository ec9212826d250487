"""The files that describe whom a command is about, and what stands in where none is given."""

from dataclasses import dataclass
from pathlib import Path

from archerfish.paper.conditions import Conditions, assumed_conditions
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.records.errors import InputError
from archerfish.records.limits import LimitsRecord, read_limits
from archerfish.records.muzzle import MuzzleRecord, read_muzzle
from archerfish.records.plant import PlantRecord, read_plant
from archerfish.simulation.setting import paper_muzzle


@dataclass(frozen=True)
class SettingFiles:
    """The robot; the paper's gimbal and our assumed conditions where a file is not given."""

    pitch: Path | None = None
    """Plant record of the pitch axis, as `identify gimbal` writes it. [paper's printed plant]"""
    yaw: Path | None = None
    """Plant record of the yaw axis. [paper's printed plant]"""
    muzzle: Path | None = None
    """Muzzle record, as `identify muzzle` writes it. [assumed conditions]"""
    limits: Path | None = None
    """Limits record: angle ranges, rates and accelerations of both axes. [paper's ranges, GM6020 motors]"""
    robot: str = ""
    """Name of the robot; results call the setting `identified-<robot>`. Required when a file is given."""


@dataclass(frozen=True)
class Setting:
    """Everything that a world is built from."""

    name: str
    """"paper" or "identified-<robot>"."""
    pitch: PlantRecord
    """Pitch axis."""
    yaw: PlantRecord
    """Yaw axis."""
    muzzle: MuzzleRecord
    """Muzzle."""
    limits: LimitsRecord
    """Limits."""
    conditions: Conditions
    """Engagements."""
    inputs: tuple[Path, ...]
    """Files that were read."""


def load_setting(files: SettingFiles) -> Setting:
    """Read the files of a setting.

    Raises:
      InputError: if a file can't be used, or files are given without the robot's name.
    """
    given = tuple(path for path in (files.pitch, files.yaw, files.muzzle, files.limits) if path is not None)
    if given and not files.robot:
        raise InputError(f"--robot must name the robot that {given[0]} describes; add for instance --robot infantry")
    if (files.pitch is None) != (files.yaw is None):
        raise InputError("--pitch and --yaw must be given together; a gimbal has both axes")
    conditions = assumed_conditions()
    printed = printed_plants()
    return Setting(
        name=f"identified-{files.robot}" if given else "paper",
        pitch=read_plant(files.pitch) if files.pitch else printed["pitch"],
        yaw=read_plant(files.yaw) if files.yaw else printed["yaw"],
        muzzle=read_muzzle(files.muzzle) if files.muzzle else paper_muzzle(conditions),
        limits=read_limits(files.limits) if files.limits else gate_limits(),
        conditions=conditions,
        inputs=given,
    )
