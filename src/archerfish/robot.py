"""A robot: plants, muzzle, sensing and limits, in a folder with one file each."""

import functools
import hashlib
import json
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol, Self, get_args

import numpy as np
from msgspec import Meta, field, structs

from archerfish.dynamics.command_limits import CommandLimits, named_limits
from archerfish.dynamics.linear_axis import GimbalModel, gimbal_model
from archerfish.dynamics.muzzle import Muzzle, muzzle_from_record
from archerfish.errors import InputError, checked_arguments, file_error, meant, one_line
from archerfish.paper.conditions import assumed_conditions, paper_muzzle
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.plugins import find_plugin
from archerfish.records.json_files import plain, read_struct, write_json
from archerfish.records.limits import LimitsRecord
from archerfish.records.muzzle import MuzzleRecord
from archerfish.records.plant import PlantRecord
from archerfish.records.record import Struct
from archerfish.records.sensing import SensingRecord

ROBOT_SCHEMA = "archerfish.robot/1"
SHORTEST_PERIOD_S, LONGEST_DELAY_S = 1e-5, 1.0
"""Of the plants of a gimbal [s]: what lies beyond is no gimbal, and would make its model huge."""
Name = Annotated[str, Meta(pattern=r"^[^\x00-\x1f\x7f\ud800-\udfff]{1,100}\Z")]
Part = Literal["pitch", "yaw", "muzzle", "sensing", "limits"]
# What is not given is one of these two objects, so that a robot that has it is known to assume it.
_assumed_muzzle, _assumed_limits = functools.cache(paper_muzzle), functools.cache(gate_limits)
RECORDS = dict(zip(get_args(Part), (PlantRecord, PlantRecord, MuzzleRecord, SensingRecord, LimitsRecord), strict=True))
"""The parts of a robot; each has a file of its own."""


class PartVerdict(Struct, frozen=True, kw_only=True):
    """What the identification says of a part."""

    usable: bool
    """Whether the part is good enough to be used."""
    headline: str
    """In one sentence."""
    reasons: tuple[str, ...] = ()
    """What the verdict rests on, in sentences."""
    next_step: str = ""
    """What to record or to change."""
    page: str = ""
    """File name of its page, in the robot's folder."""


class RobotFacts(Struct, frozen=True, kw_only=True):
    """What is known of a robot beside its records."""

    name: Name
    """By which results call the robot."""
    assumed: tuple[Part, ...] = ()
    """Parts that were not identified."""
    parts: dict[Part, PartVerdict] = field(default_factory=dict)
    """Verdicts of the identification."""


class _Written(RobotFacts, frozen=True, kw_only=True):
    """The content of robot.json."""

    records: tuple[Part, ...] = ()
    """Of which there are files."""


class Robot(RobotFacts, frozen=True, kw_only=True):
    """A robot, as far as it has been identified; the rest is assumed, and named.

    Plants are needed; muzzle and limits are the paper's where they are not given, and are in `assumed` then.

    Raises:
      InputError: if a plant can't be that of a gimbal's axis (swapped, of several inputs, not stable, of no gain) and
        has no verdict that says so; or if a field is missing.
    """

    name: Name = "robot"
    """By which results call the robot."""
    pitch: PlantRecord
    """Pitch axis."""
    yaw: PlantRecord
    """Yaw axis."""
    muzzle: MuzzleRecord = field(default_factory=_assumed_muzzle)
    """Muzzle."""
    sensing: SensingRecord | None = None
    """Camera and link; None where both are immediate and perfect."""
    limits: LimitsRecord = field(default_factory=_assumed_limits)
    """Limits of the commands."""
    folder: Path | None = None
    """Where it was loaded from."""

    def __post_init__(self) -> None:
        super().__post_init__()
        is_assumed = {"muzzle": self.muzzle is _assumed_muzzle(), "limits": self.limits is _assumed_limits()}
        assumed = tuple(part for part in RECORDS if part in self.assumed or is_assumed.get(part))
        structs.force_setattr(self, "assumed", assumed)
        for axis, plant in (("pitch", self.pitch), ("yaw", self.yaw)):
            has_verdict = axis in self.parts and not self.parts[axis].usable
            if not has_verdict and (fault := axis_fault(plant, axis)):
                raise InputError(fault)

    @classmethod
    @functools.cache
    def paper(cls) -> Self:
        """Return the paper's gimbal with the muzzle of our assumed conditions."""
        plants, muzzle, limits = printed_plants(), paper_muzzle(), gate_limits()
        return cls(name="paper", pitch=plants["pitch"], yaw=plants["yaw"], muzzle=muzzle, limits=limits)

    @classmethod
    @checked_arguments
    def load(cls, folder: str | Path, *, accept_unusable: bool = False) -> Self:
        """Read a robot.

        A folder without robot.json holds records that somebody has put there: muzzle and limits may be missing, and
        are those of the paper's robot then.

        Args:
          folder: with pitch.json, yaw.json and the others.
          accept_unusable: whether parts are taken that their identification found not usable; plants that can't be
            simulated never are.

        Raises:
          InputError: if a record is missing or damaged, or a part is not usable.
        """
        folder = Path(folder).absolute()
        facts = _Written(name=one_line(folder.resolve().name)[:100] or "robot")
        is_written = (folder / "robot.json").exists()
        if is_written:
            facts = read_struct(folder / "robot.json", _Written, ROBOT_SCHEMA, "identify again")
        files = {part: folder / f"{part}.json" for part in RECORDS}
        found: dict[str, Any] = {part: RECORDS[part].load(path) for part, path in files.items() if path.exists()}
        needed = {"pitch", "yaw", *facts.records, *(("muzzle", "limits") if is_written else ())}
        if missing := sorted(needed - found.keys()):
            robots = [path.parent.name for path in folder.parent.glob("*/pitch.json") if path.parent != folder]
            remedy = meant(folder.name, robots, "name that of a robot, as archerfish identify writes it")
            raise file_error(folder, f"expected a folder with {missing[0]}.json", remedy)
        if not is_written:
            facts = facts.replace(assumed=tuple(part for part in RECORDS if part not in found))
        try:
            robot = cls(name=facts.name, assumed=facts.assumed, parts=facts.parts, folder=folder, **found)
        except InputError as error:
            raise InputError(f"{folder}: {error}") from error
        robot.check_usable(accept_unusable=accept_unusable)
        return robot

    @classmethod
    def of(cls, robot: "RobotLike" = None, *, accept_unusable: bool = False) -> Self:
        """Return a robot as every verb takes it.

        Args:
          robot: None or "paper" for the paper's, a folder, a robot, or a result of `identify_robot`.
          accept_unusable: as of `load`, for a folder.

        Raises:
          InputError: if it is none of these, or can't be read.
        """
        found: Any = getattr(robot, "record", robot)
        if isinstance(found, cls):
            return found
        if robot is None or (isinstance(robot, str) and robot == "paper"):
            return cls.paper()
        if isinstance(robot, str | Path):
            return cls.load(robot, accept_unusable=accept_unusable)
        expected = "a folder, a Robot, what identify_robot returns, or None for the paper's robot"
        raise InputError(f"robot: expected {expected}, got a {type(robot).__name__}; give one of these")

    def check_usable(self, *, accept_unusable: bool = False) -> None:
        """Refuse a robot of which a part is not usable.

        Args:
          accept_unusable: whether parts are taken that their identification found not usable; plants that can't be
            simulated never are.

        Raises:
          InputError: naming the part, why, and what to do.
        """
        for part, verdict in self.parts.items():
            fault = axis_fault(getattr(self, part), part) if part in ("pitch", "yaw") else ""
            if verdict.usable or (accept_unusable and not fault):
                continue
            reason = fault if accept_unusable else (*verdict.reasons, verdict.headline)[0]
            remedy = verdict.next_step or "identify it again"
            problem = f"is not usable: {reason.removesuffix(f'; {remedy}')}"
            what = f"the paper's {part} in its place" if part in self.assumed else "it"
            remedy += "" if fault else f", or accept {what} (--accept-unusable, in Python accept_unusable=True)"
            place: Any = f"{self.folder or self.name}: {part}"
            if self.folder and part not in self.assumed:
                place = self.folder / f"{part}.json"
            raise file_error(place, one_line(problem), one_line(remedy))

    @checked_arguments
    def save(self, folder: str | Path) -> None:
        """Write all records and robot.json, which comes last, into a folder; what is there of a robot is replaced.

        Raises:
          InputError: if a file can't be written, or the folder has the name of a file.
        """
        folder = Path(folder)
        if folder.suffix == ".json":
            raise file_error(folder, "is the name of a file, expected that of a folder", "save a robot into a folder")
        records = [part for part in RECORDS if getattr(self, part) is not None]
        for part in records:
            getattr(self, part).save(folder / f"{part}.json")
        if self.sensing is None:  # nothing else may be missing
            (folder / "sensing.json").unlink(missing_ok=True)
        facts = {"name": self.name, "assumed": self.assumed, "parts": self.parts, "records": records}
        write_json(folder / "robot.json", {"schema": ROBOT_SCHEMA, **plain(facts)})

    def replace(self, **changes: Any) -> Self:
        """Return the same robot with some fields changed.

        A record that is replaced is neither assumed nor judged any more, and the robot is that of no folder. The
        paper's robot gets another name; beside a plant of one's own, what stays of it is assumed.

        Args:
          changes: fields; a record may be what identified it, and a plant code of a user's own, "./file.py:Name": a
            `PlantRecord`, or a function of "pitch" or "yaw" that returns one.

        Raises:
          InputError: if the code fails, or a plant can't be that of the axis.
        """
        for part in changes.keys() & RECORDS.keys():
            changes[part] = getattr(changes[part], "record", changes[part])  # of what identified it
        for axis in ("pitch", "yaw"):
            if isinstance(changes.get(axis), str):
                changes[axis] = _own_plant(changes[axis], axis)
        if new := changes.keys() & RECORDS.keys():
            is_another = self is Robot.paper() and not new.isdisjoint(("pitch", "yaw"))
            assumed = ("pitch", "yaw", "muzzle", "limits") if is_another else self.assumed
            assumed = tuple(part for part in assumed if part not in new)
            parts = {part: verdict for part, verdict in self.parts.items() if part not in new}
            name = f"paper, other {' and '.join(sorted(new))}" if self is Robot.paper() else self.name
            changes = {"name": name, "assumed": assumed, "parts": parts, "folder": None, **changes}
        return super().replace(**changes)

    def record_digests(self) -> dict[str, str]:
        """Return the SHA-256 of each record, without its provenance; a robot without sensing has none for it.

        Neither is a plant's validation residual in it, for nothing that is simulated or trained depends on that.
        """
        contents = {part: plain(getattr(self, part)) for part in RECORDS if getattr(self, part) is not None}
        for content in contents.values():
            content["provenance"] = {}
            content.pop("validation_residual", None)
        return {part: _digest(content) for part, content in contents.items()}

    def digest(self) -> str:
        """Return one SHA-256 for all that the robot's behaviour depends on."""
        return _digest(self.record_digests())

    def gimbal(self, period_s: float) -> GimbalModel:
        """Return the best estimate of both axes for decisions every `period_s` [s], the mean command latency included.

        Raises:
          InputError: if the period is no multiple of the plants' sampling periods.
        """
        latency_s = (self.sensing.link.command_latency or 0.0) if self.sensing else 0.0
        return gimbal_model(self.pitch, self.yaw, period_s, latency_s)

    def command_limits(self, task: Any) -> CommandLimits:
        """Return the limits of the commands in a `Task`."""
        return named_limits(task.command_limit, self.limits, assumed_conditions().line_of_sight_lead)

    def muzzle_model(self) -> Muzzle:
        """Return the best estimate of the muzzle."""
        return muzzle_from_record(self.muzzle)

    def __repr__(self) -> str:
        axes = (repr(each).removeprefix("PlantRecord(")[:-1] for each in (self.pitch, self.yaw))
        parts = [self.name, *axes, f"muzzle: {self.muzzle.speed:.4g} m/s", *(["sensing"] if self.sensing else [])]
        parts += [f"assumed: {', '.join(self.assumed)}"] if self.assumed else []
        return f"Robot({'; '.join(parts)})"


class Identified(Protocol):
    """A result that has a robot, as that of `identify_robot`."""

    @property
    def record(self) -> Robot:
        """The robot."""


RobotLike = Robot | Identified | str | Path | None
"""A robot as every verb takes it; see `Robot.of`."""


def _digest(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _own_plant(spec: str, axis: str) -> PlantRecord:
    found = find_plugin(spec, "plant")
    with found.running():
        plant = found.value(axis) if callable(found.value) else found.value
        if not isinstance(plant, PlantRecord):
            raise InputError(f"gives a {type(plant).__name__} for {axis}, expected a PlantRecord; return one")
        if fault := axis_fault(plant, axis):
            raise InputError(fault)
    return plant.replace(axis=axis)


def axis_fault(plant: PlantRecord, axis: str) -> str:
    """Return why a plant can't be that of a gimbal's axis, and what to do; "" if it can."""
    if plant.axis in {"pitch", "yaw"} - {axis}:
        remedy = f"swap the two, or give plant.replace(axis='{axis}')"
        return f"{axis} is the plant of the {plant.axis} axis, expected that of {axis}; {remedy}"
    if plant.B.shape[1] != 1:
        return f"{axis} has {plant.B.shape[1]} inputs, expected one; identify it with one input"
    if plant.sample_period_s < SHORTEST_PERIOD_S:
        period_s = plant.sample_period_s
        return f"{axis} has a sampling period of {period_s:g} s, expected {SHORTEST_PERIOD_S:g} s or more; resample it"
    longest = max([plant.delay_samples, *plant.draw_delays]) * plant.sample_period_s
    if longest > LONGEST_DELAY_S:
        return f"{axis} has a delay of {longest:g} s, expected {LONGEST_DELAY_S:g} s or less; identify again"
    matrices = [plant.A[None], plant.draws["A"]] if plant.draws else [plant.A[None]]
    largest = float(np.max(np.abs(np.linalg.eigvals(np.concatenate(matrices)))))
    if largest >= 1.0:
        remedy = "close its loop on an angle command, or discretise a continuous model"
        return f"{axis} has a pole of magnitude {largest:.4g}, expected less than 1; {remedy}"
    gain = plant.dc_gain[0, 0]
    return (
        "" if gain > 0.0 else f"{axis} has a steady gain of {gain:.4g}, expected more than 0; check the sign of its log"
    )
