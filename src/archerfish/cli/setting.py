"""The files that describe whom a command is about, and what stands in where none is given."""

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from archerfish.cli.restored_options import restore_options
from archerfish.paper.conditions import Conditions, assumed_conditions
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.plugins import names_code, not_run
from archerfish.records import storage
from archerfish.records.errors import InputError, file_error
from archerfish.records.extensions import FORMS, is_extension
from archerfish.records.limits import LimitsRecord, read_limits
from archerfish.records.muzzle import MuzzleRecord, read_muzzle
from archerfish.records.own_plant import find_plant
from archerfish.records.plant import USABLE_FIT_PERCENT, PlantQuality, PlantRecord, read_plant
from archerfish.records.provenance import provenance
from archerfish.records.sensing import SensingRecord, read_sensing
from archerfish.simulation.environment import PureWorld
from archerfish.simulation.setting import make_world, paper_muzzle

NOT_KEPT = ("out", "overwrite", "json")
"""Options that a run folder does not hold: they say where a command writes, not what it finds."""


def _file(default: str) -> Any:
    return tyro.conf.arg(metavar="FILE", help_behavior_hint=f"(default: {default})")


@dataclass(frozen=True)
class SettingFiles:
    """The robot; the paper's gimbal and our assumed conditions where a file is not given."""

    plant: Annotated[str, tyro.conf.arg(metavar="FOLDER|NAME", help_behavior_hint="")] = ""
    """Both axes at once, in the place of --pitch and --yaw: a folder with pitch.json and yaw.json, or a function of
    your own, ./FILE.py:NAME or MODULE:NAME (docs/adding.md)."""
    pitch: Annotated[Path | None, _file("the paper's printed plant")] = None
    """Plant record of the pitch axis, as identify gimbal writes it, or a function of your own; --yaw must come with
    it."""
    yaw: Annotated[Path | None, _file("the paper's printed plant")] = None
    """The same of the yaw axis; --pitch must come with it."""
    muzzle: Annotated[Path | None, _file("the assumed conditions")] = None
    """Muzzle record, as identify muzzle writes it."""
    sensing: Annotated[Path | None, _file("immediate and perfect sight")] = None
    """Sensing record, as identify sensing writes it: what the camera and the link do."""
    limits: Annotated[Path | None, _file("the paper's ranges, GM6020 motors")] = None
    """Limits record: angle ranges, rates and accelerations of both axes."""
    accept_unusable: bool = False
    """Go on with plants that their identification called useless; what comes out says nothing of the robot."""
    robot: Annotated[str, tyro.conf.arg(metavar="NAME", help_behavior_hint="")] = ""
    """Name of the robot, required with any of these files; results call the setting identified-NAME."""


PLANTS = ("plant", "pitch", "yaw")
"""Options that name plants, which may be code."""
RobotOptions = Annotated[SettingFiles, tyro.conf.arg(name="")]
"""The files of a robot as options without a prefix: --pitch, not --setting.pitch."""


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
    sensing: SensingRecord | None
    """Camera and link; None where they are immediate and perfect."""
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
    files = both_axes(files)
    others = [path for path in (files.muzzle, files.sensing, files.limits) if path is not None]
    given = [path for path in (files.pitch, files.yaw) if path is not None] + others
    problems = []
    if (files.pitch is None) != (files.yaw is None):
        problems.append("--pitch and --yaw must be given together; a gimbal has both axes")
    if given and not files.robot:
        problems.append(f"--robot must name the robot that {given[0]} describes; add for instance --robot infantry")
    if problems:
        raise InputError("; ".join(problems))
    conditions, plants = assumed_conditions(), printed_plants()
    sources: list[Path | None] = []
    for axis, path in (("pitch", files.pitch), ("yaw", files.yaw)):
        if path is not None:
            plants[axis], source = _read_axis(path, axis, files.accept_unusable)
            sources.append(source)
    muzzle = paper_muzzle(conditions)
    if files.muzzle:
        muzzle = read_muzzle(files.muzzle)
        conditions = with_muzzle(conditions, muzzle)
    return Setting(
        name=f"identified-{files.robot}" if given else "paper",
        pitch=plants["pitch"],
        yaw=plants["yaw"],
        muzzle=muzzle,
        sensing=read_sensing(files.sensing) if files.sensing else None,
        limits=read_limits(files.limits) if files.limits else gate_limits(),
        conditions=conditions,
        inputs=tuple(dict.fromkeys(each for each in (*sources, *others) if each is not None)),
    )


def trained_for(policy: Path, given: SettingFiles | None = None) -> SettingFiles:
    """Return the robot's files that the run folder of a policy names, and in their place those that were given.

    Args:
      policy: its record.
      given: as typed; what has its default counts as not given.

    Raises:
      InputError: if config.json can't be used, or names code for a plant and no plant was given.
    """
    given = given or SettingFiles()
    recorded = recorded_files(policy)
    if plant_code(recorded) and not _typed(given).keys() & set(PLANTS):
        # An axis that is data goes along: what is typed for one axis takes the place of both.
        named = {f"--{name}": str(getattr(recorded, name)) for name in PLANTS if getattr(recorded, name)}
        source, facts = _recorded(policy)
        raise not_run(source, named, _hashes(facts))
    return overlaid(given, recorded)


def recorded_files(policy: Path) -> SettingFiles:
    """Return what the run folder of a policy names as the robot's files; the paper's gimbal without a config.json.

    It may name code, which must not be run for that: `trained_for` refuses it.

    Args:
      policy: its record.

    Raises:
      InputError: if config.json can't be used.
    """
    source, facts = _recorded(policy)
    setting = facts.get("setting")
    # A trial of a sweep and a part of a larger run have a name there.
    if not isinstance(setting, dict | str | None):
        problem = f'"setting" is {setting!r}, expected an object'
        raise file_error(source, problem, "put back what was changed, or train again")
    return restore_options(SettingFiles, setting, source) if isinstance(setting, dict) else SettingFiles()


def _recorded(policy: Path) -> tuple[Path, dict[str, Any]]:
    """Return the config.json beside a policy, and what it holds; nothing where there is none."""
    source = policy.with_name("config.json")
    plain = storage.read_json(source) if source.is_file() else None
    return source, plain if isinstance(plain, dict) else {}


def _hashes(facts: dict[str, Any]) -> dict[str, str]:
    """Return what a config.json holds of its inputs: name of a file → SHA-256."""
    origin = facts.get("provenance")
    inputs = origin.get("inputs") if isinstance(origin, dict) else None
    return {name: str(digest) for name, digest in inputs.items()} if isinstance(inputs, dict) else {}


def plant_code(files: SettingFiles) -> dict[str, str]:
    """Return the options of a robot's files that name code for a plant, and what they say: option → name."""
    said = {name: str(getattr(files, name)) for name in PLANTS if getattr(files, name)}
    return {name: spec for name, spec in said.items() if is_own_plant(Path(spec)) and names_code(spec)}


def overlaid(given: SettingFiles, others: SettingFiles) -> SettingFiles:
    """Return the files that were given, and of others what was not.

    Args:
      given: as typed; what has its default counts as not given.
      others: such as a policy was trained for.
    """
    typed = _typed(given)
    if typed.keys() & set(PLANTS):
        others = replace(others, plant="", pitch=None, yaw=None)
    return replace(others, **typed)


def _typed(given: SettingFiles) -> dict[str, Any]:
    return {name: value for name, value in vars(given).items() if value != getattr(SettingFiles(), name)}


def both_axes(files: SettingFiles) -> SettingFiles:
    """Return the same files with --pitch and --yaw in the place of --plant.

    Raises:
      InputError: if both are given, or there is no such folder.
    """
    if not files.plant:
        return files
    if files.pitch is not None or files.yaw is not None:
        raise InputError("--plant gives both axes, --pitch or --yaw one; give either --plant, or the other two")
    folder = Path(files.plant)
    if folder.is_dir():
        return replace(files, plant="", pitch=folder / "pitch.json", yaw=folder / "yaw.json")
    if not is_own_plant(folder):
        raise file_error(
            folder, "is no folder with pitch.json and yaw.json", f"name one, or a plant of your own: {FORMS}"
        )
    return replace(files, plant="", pitch=folder, yaw=folder)


def is_own_plant(path: Path) -> bool:
    """Tell whether what was given for an axis is a plant of the user's own, and not a record."""
    return not path.exists() and is_extension(str(path), "plant")


def setting_world(setting: Setting, command_limit: str) -> PureWorld:
    """Build the simulator of a setting.

    Args:
      setting: the robot.
      command_limit: "box", "gate" or "los-2deg".
    """
    return make_world(
        setting.pitch,
        setting.yaw,
        setting.muzzle,
        setting.limits,
        command_limit,
        setting.conditions,
        sensing=setting.sensing,
    )


def with_muzzle(conditions: Conditions, muzzle: MuzzleRecord) -> Conditions:
    """Let the conditions tell of the muzzle that is used, for the report lists them."""
    return replace(
        conditions,
        muzzle_speed=muzzle.speed,
        muzzle_speed_sd=muzzle.speed_sd,
        dispersion=math.sqrt((muzzle.pitch_sd**2 + muzzle.yaw_sd**2) / 2),
        drag=muzzle.drag,
    )


def _read_axis(path: Path, axis: str, accept_unusable: bool) -> tuple[PlantRecord, Path | None]:
    """Return the plant and the file that it comes from."""
    if is_own_plant(path):
        plant, extension = find_plant(str(path), axis)
        return plant, extension.file
    plant, other = read_plant(path), {"pitch": "yaw", "yaw": "pitch"}[axis]
    # A record without a verdict was written by hand, or before there were any: its author answers for it.
    if plant.quality is not None and not plant.quality.usable and not accept_unusable:
        raise InputError(_unusable(path, plant.quality))
    if plant.axis == other:
        raise InputError(f"{path}: is the plant of the {other} axis, given as --{axis}; swap --pitch and --yaw")
    return plant, path


def _unusable(path: Path, quality: PlantQuality) -> str:
    role, page = "held back" if quality.held_back else "fitted", path.with_suffix(".html").name
    return (
        f"{path}: the plant is not to be used, it fits {quality.log} ({role}) to {quality.fit_percent:.1f} %, expected "
        f"{USABLE_FIT_PERCENT:g} % or more; identify the axis anew ({page} says what to record), or "
        "pass --accept-unusable"
    )


def configuration(command: Any, setting: Setting, inputs: Iterable[Path] = ()) -> dict[str, Any]:
    """Return the resolved configuration of a command, as written into its run folder.

    Args:
      command: its options, a dataclass with a seed.
      setting: what its files were resolved to.
      inputs: other files that were read.
    """
    plain = {name: _plain(value) for name, value in asdict(command).items() if name not in NOT_KEPT}
    return {**plain, "setting_name": setting.name, "provenance": provenance(command.seed, (*setting.inputs, *inputs))}


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _plain(each) for name, each in value.items()}
    if isinstance(value, tuple):
        return [_plain(each) for each in value]
    return str(value) if isinstance(value, Path) else value
