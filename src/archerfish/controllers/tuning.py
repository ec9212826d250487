"""What is tuned of the controllers, on which grids, and the settings that are kept for a robot and a task."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, TypeAlias

from msgspec import Meta

from archerfish.compiled import cache_folder
from archerfish.errors import InputError
from archerfish.paper.conditions import paper_tuning
from archerfish.plugins import find_plugin
from archerfish.provenance import library_versions
from archerfish.records.json_files import plain, read_struct, write_json
from archerfish.records.record import Share, Struct
from archerfish.robot import Robot
from archerfish.storage import locked
from archerfish.task import DRAWN, EQ_7, Task
from archerfish.tracking.kalman_filter import INITIAL_SPEED

TUNING_SCHEMA = "archerfish.tuning/1"
SMOOTHING = 1e-4
"""Weight of the changes of the command in a preview against squared angle errors, where nothing is tuned."""


class Tuning(Struct, frozen=True, kw_only=True, eq=True):
    """The settings of a classical controller that are tuned; a controller uses some of them."""

    acceleration_sd: Annotated[float, Meta(ge=0.0, le=1e100)]
    """Process noise of the Kalman filter, as a standard deviation of the target's acceleration [m/s²]."""
    extra_lead_s: Annotated[float, Meta(ge=-10.0, le=10.0)] = 0.0
    """Lead beyond what the controller has a model of, as for the lag of a gimbal; negative where targets turn back
    before pellets arrive [s]."""
    smoothing: Annotated[float, Meta(ge=1e-100, le=1e100)] = SMOOTHING
    """Weight of the changes of the command in a preview against squared angle errors."""
    initial_speed: Annotated[float, Meta(ge=1e-100, le=1e100)] = INITIAL_SPEED
    """Standard deviation of the target's speed at the first detection that the filter assumes [m/s]."""
    velocity_decay: Annotated[float, Meta(ge=0.0, le=1e100)] = 1.0
    """Share of the estimated velocity at which the target is predicted to go on, 0…1."""
    turn_rate: Annotated[float, Meta(ge=0.0, le=1e100)] = 1.0
    """How often a target is taken to turn back [1/s]."""


TuningLike: TypeAlias = Literal["kept", "start"] | Tuning | Mapping[str, Tuning]
"""Settings as a verb takes them: those that are kept, those where a search begins, or given ones."""


class Grid(NamedTuple):
    """Values of one setting: start · ratioⁱ, or start + step · i, for whole i."""

    start: float  # value at i = 0, where a search begins
    ratio: float = 1.0  # between neighbours
    step: float = 0.0  # between neighbours of a setting that has either sign
    last: int | None = None  # largest i, where the setting has a natural bound

    def value(self, index: int) -> float:
        """Return the value at an index."""
        return float(f"{self.start * self.ratio**index + self.step * index:.9g}")


_LEAD, _SMOOTHING = {"extra_lead_s": Grid(0.0, step=0.02)}, {"smoothing": Grid(0.1, 4.0)}
_SPEED = {"initial_speed": Grid(0.25, 2.0)}
_TRACKER = {"acceleration_sd": Grid(4.0, 2.0), **_SPEED, "velocity_decay": Grid(1.0, 1.25, last=0), **_LEAD}
_MODELS = {"turn_rate": Grid(1.0, 2.0), "acceleration_sd": Grid(0.5, 2.0), **_SPEED}
GRIDS: Mapping[str, Mapping[str, Grid]] = {
    "kalman": _TRACKER,
    "kalman-lq": {**_TRACKER, **_SMOOTHING},
    "imm-lq": {**_MODELS, **_SMOOTHING, **_LEAD},
    "parabola-lq": {**_SMOOTHING, **_LEAD},
}
"""Name → what is tuned of a controller, in the order of the search."""


def tuning_at(name: str, place: tuple[int, ...] | None = None) -> Tuning:
    """Return the settings at indices of the grids of a name, where the search begins if none are given."""
    grids = GRIDS.get(name, {})
    indices = zip(grids.items(), place or (0,) * len(grids), strict=True)
    values = {setting: grid.value(index) for (setting, grid), index in indices}
    return Tuning(**{"acceleration_sd": 0.0, **values})


class KeptTuning(Struct, frozen=True, kw_only=True, eq=True):
    """Settings that are kept, with all that they depend on."""

    controller: str
    """One of `GRIDS`."""
    robot: str
    """Digest of the records."""
    task: Task
    """Without its name, with its lengths."""
    grids: str
    """What was searched, and the digest of a user's motion."""
    version: str
    """Of Archerfish."""
    tuning: Tuning
    """The best settings."""
    hit_rate: Share = 0.0
    """On the tuning draws."""
    tried: Annotated[int, Meta(ge=1, le=10_000)] = 1
    """Settings tried."""


class KeptTunings(Struct, frozen=True, kw_only=True):
    """The content of tuning.json."""

    tunings: tuple[KeptTuning, ...] = ()
    """In the order of their making."""


def entry(name: str, robot: Robot, task: Task) -> KeptTuning:
    """Return the entry of a controller, a robot and a task before tuning; `keep` takes it with the best settings."""
    return KeptTuning(
        controller=name,
        robot=robot.digest(),
        task=task.replace(name="", lengths_s=task.lengths),
        grids=f"{GRIDS[name]!r} {_motion_digest(task) or ''}",
        version=library_versions()["archerfish"],
        tuning=tuning_at(name),
    )


def kept(name: str, robot: Robot, task: Task) -> Tuning | None:
    """Return the settings that are kept of a controller for a robot and a task, None where none are.

    Those of the paper's robot and targets come with Archerfish. The others are in the robot's folder, tuning.json, and
    those of a robot without folder in the user's cache.

    Raises:
      InputError: if the file can't be read.
    """
    if _motion_digest(task) == "":
        return None
    begun = entry(name, robot, task)
    shipped = Task.load("paper").replace(lengths_s=(1.0,))
    if begun.task.replace(command_limit="gate") == shipped and begun.robot == Robot.paper().digest():
        shipped_tunings = paper_tuning(task.command_limit)
        return Tuning(**shipped_tunings[name]) if name in shipped_tunings else None
    for found in _read_kept(_tuning_file(robot)):
        if found.replace(tuning=begun.tuning, hit_rate=0.0, tried=1) == begun:
            return found.tuning
    return None


def keep(found: KeptTuning, robot: Robot) -> None:
    """Keep settings that were found; nothing where the file can't be written, or the motion has no digest."""
    path = _tuning_file(robot)
    if path is not None and _motion_digest(found.task) != "":
        with suppress(InputError), locked(path.parent, 10.0, "tuning.lock"):
            write_json(path, {"schema": TUNING_SCHEMA, **plain(KeptTunings(tunings=(*_read_kept(path), found)))})


def _motion_digest(task: Task) -> str | None:
    """Return the digest of a user's motion, whose name may be that of another file tomorrow; None for another one."""
    return None if task.motion in (*EQ_7, *DRAWN) else find_plugin(task.motion, "motion").digest


def _tuning_file(robot: Robot) -> Path | None:
    """Return where the settings for a robot are kept; None where the user's cache is off."""
    if robot.folder is not None:
        return robot.folder / "tuning.json"
    folder = cache_folder("tuning")
    return folder and folder / f"{robot.digest()[:16]}.json"


def _read_kept(path: Path | None) -> tuple[KeptTuning, ...]:
    if path is None or not path.exists():
        return ()
    return read_struct(path, KeptTunings, TUNING_SCHEMA, "remove it, and it is made again").tunings
