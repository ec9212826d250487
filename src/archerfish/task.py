"""The task: which targets are engaged where, for how long, under which command limit, and what counts as a hit."""

import itertools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from msgspec import Meta, structs

from archerfish.arrays import Array, lift, namespace, select, single_precision, tree
from archerfish.errors import InputError, checked_arguments, file_error, meant, one_line
from archerfish.plugins import Plugin, is_plugin, names_code, names_object, registered_name
from archerfish.protocols import Engagement, Plates
from archerfish.records.json_files import plain, read_toml
from archerfish.records.record import Angle, Share, Struct, Text
from archerfish.storage import write_bytes
from archerfish.targets.kinds import KINDS
from archerfish.targets.mixture import MIXTURES, drawn_path, path_uniforms
from archerfish.targets.motion import LONGEST_S, Parabola, disc
from archerfish.targets.user_motion import UNIFORMS, find_motion, user_target

EQ_7 = ("paper", "static", "dynamic")
"""Motions of the paper's targets: all of them, those of Table II, those of Table III."""
DRAWN = (*MIXTURES, *KINDS)
"""Motions whose parameters are drawn for each target."""
_LABELLED = ("name", "motion", "ranges_m", "lengths_s", "command_limit", "short_share", "still_share")
"""Fields of a task that the labels of an evaluation's cells say, or that training alone uses."""
_FIRST = 6  # uniform draws of every engagement: distance, side, speed, phase, still or moving and length, plant
_RANGES = ((1.0, 2.0), (2.0, 3.0), (3.0, 4.0), (4.0, 5.0))
_Positive = Annotated[float, Meta(ge=1e-4, le=1000.0)]
_Magnitude = Annotated[float, Meta(ge=0.0, le=1000.0)]


@tree()
class StillOrMoving:
    """A target of which some members are as at time zero, with their first plate at their place."""

    place: Array  # [m], B + (3,)
    moving: Array  # bool, B
    target: Any  # any target

    @property
    def plates(self) -> int:
        """Number of plates."""
        return int(self.target.plates)

    def at(self, time: Array) -> Plates:
        """Return the plates at times [s] of shape B or (N,) + B."""
        moved, still = self.target.at(time), self.target.at(0.0 * time)
        place = still.position - still.position[..., :1, :] + lift(self.place[..., None, :], still.position)
        return select(lift(self.moving, time), Plates(*moved), Plates(place, still.normal_yaw))


@tree(static=("motion",))
class Scenario:
    """The distribution of a task's engagements, so that one compiled program serves all tasks of a motion."""

    motion: Any  # "paper" for eq (7), one of `DRAWN`, or a user's plugin
    range_m: Array  # smallest and largest distance of the place [m], (2,)
    lengths: Array  # of short and long engagements [s], (2,)
    short_share: Array  # of the engagements, 0…1, ()
    still_share: Array  # of the targets, 0…1, (); 0 where parameters are drawn
    lateral: Array  # the place is at most this far to the side [m], ()
    height: Array  # of the plate above the gimbal's pivot [m], ()
    swing: tuple[Array, Array, Array]  # of eq (7): largest speed [m/s], half width [m] and rise [m], () each
    curvature: Array  # of eq (7) [1/m], ()
    start: Array  # pitch and yaw of the resting gimbal [rad], (2,)
    plants: Array  # number of posterior draws to choose from, ()

    @property
    def uniforms(self) -> int:
        """Uniform draws per engagement."""
        return _FIRST + (path_uniforms(self.motion) if isinstance(self.motion, str) else UNIFORMS)

    def draw(self, uniforms: Array) -> Engagement:
        """Turn uniform draws in [0, 1) into engagements.

        Args:
          uniforms: shape B + (self.uniforms,).

        Raises:
          InputError: if a user's motion fails, or, in NumPy, its targets are not before the gimbal.
        """
        xp, share = namespace(uniforms), self.still_share
        distance, side, speed, phase, still, plant = (uniforms[..., index] for index in range(_FIRST))
        moving = still >= share
        # What the choice between still and moving leaves of its draw is uniform again.
        left = xp.where(moving, still - share, still) / xp.where(moving, 1.0 - share, share)
        duration = xp.where(left < self.short_share, self.lengths[0], self.lengths[1])
        forward = self.range_m[0] + (self.range_m[1] - self.range_m[0]) * distance
        place = xp.stack([forward, self.lateral * (2.0 * side - 1.0), self.height + 0.0 * side], axis=-1)
        target = self._target(place, self.swing[0] * speed, phase, moving, (uniforms[..., _FIRST:], duration))
        plant = xp.astype(xp.floor(plant * self.plants), xp.int32)
        return Engagement(target, lift(self.start, place) + 0.0 * place[..., :2], plant, duration)

    def _target(self, place: Array, speed: Array, phase: Array, moving: Array, rest: tuple[Array, Array]) -> Any:
        if self.motion in DRAWN:
            return disc(drawn_path(self.motion, place, *rest, self.swing), place)
        if self.motion == "paper":
            # A target that stands still stands at the vertex: a quarter of the cycle from the turn.
            xp, still = namespace(place), 0.0 * speed
            speed, phase = xp.where(moving, speed, still), xp.where(moving, phase, still + 0.25)
            return disc(Parabola(place, speed, phase, self.swing[1] + still, self.curvature + still), place)
        target = StillOrMoving(place, moving, user_target(self.motion, place, speed, rest[0]))
        if namespace(place) is np:
            _check_places(self.motion, target, rest[1])
        return target


def _check_places(found: Plugin, target: Any, duration: Array) -> None:
    """Refuse targets of a user's motion, of NumPy arrays, that are nowhere or not in front of the gimbal."""
    times = duration * np.linspace(0.0, 1.0, 26, dtype=np.float32).reshape(-1, *(1,) * duration.ndim)
    with found.running():
        position = np.asarray(target.at(times).position)
    wrong = ~np.all(np.isfinite(position), axis=-1) | ~(position[..., 0] > 0.0)
    if np.any(wrong):
        at = f"{position[wrong][0].tolist()} m after {times[np.nonzero(wrong)[:-1]][0]:.2f} s"
        raise InputError(f"{found.spec}: a target is at {at}, expected numbers and x > 0; keep it before the gimbal")


class TaskCell(NamedTuple):
    """One cell: engagements of one kind at one range."""

    table: str | None
    """The paper's table whose cell this is: "II" or "III"; None for others."""
    motion: str
    """Name of the motion."""
    range_m: tuple[float, float]
    """Smallest and largest distance [m]."""
    length_s: float
    """Length of its engagements [s]."""
    stream: int
    """Of random numbers: the same engagements whichever cells are beside it."""
    decisions: int
    """In an engagement."""
    scenario: Scenario
    """How its engagements are drawn."""


class Task(Struct, frozen=True, kw_only=True, eq=True):
    """Which targets are engaged where, for how long, under which command limit, and what counts as a hit.

    Raises:
      InputError: naming a field that is out of its bounds.
    """

    name: Text = ""
    """By which results call it; the motion's if empty."""
    motion: Text = "any"
    """One of `EQ_7` or `DRAWN`, or a user's: ./FILE.py:NAME, MODULE:NAME, an entry point, or the function itself."""
    ranges_m: Annotated[tuple[tuple[_Positive, _Positive], ...], Meta(min_length=1, max_length=100)] = _RANGES
    """Distances of the targets' places [m], cells each; training draws from the nearest to the farthest."""
    lengths_s: Annotated[tuple[_Positive, ...], Meta(max_length=100)] = ()
    """Lengths of engagements [s], cells each; training draws the first and the last. If empty: `lengths`."""
    short_share: Share = 0.75
    """Share of a training's engagements of the first length, 0…1: so both lengths have as many decisions."""
    period_s: _Positive = 0.02
    """Decision period: one command and at most one pellet each [s]."""
    command_limit: Literal["gate", "box", "los-2deg"] = "gate"
    """What the world allows a controller to command."""
    hit_radius_m: _Positive = 0.06
    """Largest miss that hits [m]."""
    still_share: Share = 0.5
    """Share of a training's targets of eq (7), or of a user's motion, that don't move, 0…1."""
    lateral_m: _Magnitude = 0.7
    """Places are at most this far to either side [m]."""
    height_m: Annotated[float, Meta(ge=-1000.0, le=1000.0)] = 0.0
    """Height of the plate above the gimbal's pivot [m]."""
    max_speed_m_s: _Magnitude = 0.35
    """Largest lateral speed of eq (7), and of a user's motion [m/s]."""
    curvature_1_m: _Positive = 3.0
    """Coefficient of eq (7) [1/m]."""
    rise_m: _Positive = 0.04
    """Targets of eq (7) turn back where x − X₀ reaches this [m]."""
    start: tuple[Angle, Angle] = (0.0, 0.0)
    """Pitch and yaw of the resting gimbal [rad]."""

    def __post_init__(self) -> None:
        if callable(self.motion):
            structs.force_setattr(self, "motion", registered_name(self.motion, "motion"))
        super().__post_init__()
        structs.force_setattr(self, "name", self.name or self.motion.rpartition(":")[2])
        lengths, longest = self.lengths, LONGEST_S if self.motion in DRAWN else np.inf
        rising = all(low < high for low, high in (*self.ranges_m, *itertools.pairwise(lengths)))
        if not rising or lengths[0] < self.period_s or lengths[-1] > longest:
            expected = f"the smaller one first, and lengths of {self.period_s:g}…{longest:g} s"
            found = f"{self.ranges_m} and {lengths}"
            raise InputError(f"Task: fields ranges_m and lengths_s: expected {expected}, got {found}; correct it")

    def replace(self, **changes: Any) -> Self:
        """Return the same task with some fields changed; the name that a motion gave changes with it."""
        if "motion" in changes and self.name == type(self)(motion=self.motion).name:
            changes = {"name": "", **changes}
        return super().replace(**changes)

    def conditions(self) -> dict[str, str]:
        """Return what cells of an evaluation have in common and labels don't say; the usual ones are the paper's."""
        return {name: str(value) for name, value in plain(self).items() if name not in _LABELLED}

    def __repr__(self) -> str:
        usual, fields = type(self)(motion=self.motion), self.__struct_fields__
        unlike = [f"{name}={getattr(self, name)!r}" for name in fields if getattr(self, name) != getattr(usual, name)]
        return f"Task({', '.join([f'motion={self.motion!r}', *unlike])})"

    @property
    def lengths(self) -> tuple[float, ...]:
        """Lengths of engagements [s]; if none are given 1 and 3 s where parameters are drawn, else 1 s."""
        return self.lengths_s or ((1.0, 3.0) if self.motion in DRAWN else (1.0,))

    @classmethod
    @checked_arguments
    def load(cls, name: str | Path, motion: str | None = None) -> Self:
        """Return a task by its name, or read one from a file.

        Args:
          name: one of `EQ_7` or `DRAWN`, a user's motion, or a file whose name ends in .toml.
          motion: in the place of the file's, for code that only a file names is not run.

        Raises:
          InputError: naming what is unknown or out of bounds, of a file with its field.
        """
        path, content = Path(name), dict[str, Any](motion=str(name))
        if path.suffix == ".toml":
            content = {"name": path.stem} | read_toml(path, "correct it")
        try:
            if path.suffix == ".toml" and names_code(str(content.get("motion"))) and not motion:
                raise InputError("code that only a file names is not run; give it as the motion, beside the file")
            task = cls(**content | ({"motion": motion} if motion else {}))
            if not names_code(task.motion):
                task._motion()  # refuses an unknown name
            return task
        except (OSError, ValueError, TypeError, RecursionError) as error:
            problem = one_line(str(error)).removeprefix(f"{name}: ").removeprefix("Task: ").removesuffix("; correct it")
            raise file_error(path, problem[:400], "correct it") from error

    @classmethod
    def of(cls, task: "TaskLike" = "any") -> Self:
        """Return a task as every verb takes it: one that is there, by its name or TOML file, or a user's motion.

        Raises:
          InputError: if it is none of these, or can't be read.
        """
        if isinstance(task, cls):
            return task
        if isinstance(task, str | Path):
            return cls.load(task)
        if callable(task):
            return cls(motion=registered_name(task, "motion"))
        expected = "a name, a TOML file, a Task or a motion"
        raise InputError(f"task: expected {expected}, got a {type(task).__name__}; give one of these")

    @checked_arguments
    def save(self, path: str | Path) -> None:
        """Write the task as a TOML file.

        Raises:
          InputError: if it can't be written, or its motion is an object, which no file can name.
        """
        if names_object(self.motion):
            problem = f"field motion: {self.motion} is an object of this process, which no file can name"
            raise InputError(f"Task: {problem}; write its code into a file, and name that: ./FILE.py:NAME")
        fields = {name: json.dumps(getattr(self, name), ensure_ascii=False) for name in self.__struct_fields__}
        write_bytes(Path(path), "".join(f"{name} = {value}\n" for name, value in fields.items()).encode())

    def scenario(self, plants: int = 1) -> Scenario:
        """Return the distribution of a training's engagements: all ranges and both lengths.

        Args:
          plants: number of posterior draws of the world's plant.

        Raises:
          InputError: if a user's motion can't be used.
        """
        share = {"static": 1.0, "dynamic": 0.0}.get(self.motion, self.still_share * (self.motion not in DRAWN))
        made: Scenario = self._scenario(self._motion(), self.ranges_m, self.lengths, share, plants)
        made.draw(np.random.default_rng(0).random((100, made.uniforms), np.float32))  # a user's targets are checked
        return made

    def cells(self) -> tuple[TaskCell, ...]:
        """Return the cells of an evaluation: for each length each kind of target at each range.

        Raises:
          InputError: if a user's motion can't be used.
        """
        if self.motion in DRAWN:
            kinds: list[Any] = [(None, k, k, 0.0, at) for at, k in enumerate(KINDS) if self.motion in (*MIXTURES, k)]
        else:
            motion = self._motion()
            static, dynamic = ("II", "static", motion, 1.0, 0), ("III", "dynamic", motion, 0.0, 1)
            users = (None, getattr(motion, "name", ""), motion, 0.0, 1)
            kinds = {"paper": [static, dynamic], "static": [static], "dynamic": [dynamic]}.get(self.motion, [users])
        # A range of the default ones has the random numbers of its place among them, whichever are beside it.
        places = {range_m: place for place, range_m in enumerate(dict.fromkeys((*_RANGES, *self.ranges_m)))}
        cells = []
        for length, (table, name, motion, share, row), range_m in itertools.product(self.lengths, kinds, self.ranges_m):
            place = places[range_m]
            stream = place + (4 * row if place < len(_RANGES) else 1000 * (row + 1))
            decisions, scenario = round(length / self.period_s), self._scenario(motion, [range_m], [length], share)
            own = table if length == 1.0 else None
            cells.append(TaskCell(own, name, range_m, length, stream, decisions, scenario))
        return tuple(cells)

    def _motion(self) -> Any:
        """Return the motion of a scenario; a user's is checked."""
        if self.motion in (*EQ_7, *DRAWN):
            return self.motion if self.motion in DRAWN else "paper"
        if not is_plugin(self.motion, "motion"):
            expected = f"expected one of {', '.join((*EQ_7, *DRAWN))} or ./FILE.py:NAME"
            remedy = meant(self.motion, (*EQ_7, *DRAWN), "correct it")
            raise InputError(f"Task: field motion: {expected}, got {self.motion!r}; {remedy}")
        if (name := self.motion.rpartition(":")[2]) in (*EQ_7, *DRAWN):
            raise InputError(f"{self.motion}: {name} is the name of a motion of ours; give yours another one")
        found = find_motion(self.motion)
        if self.lengths[-1] > (longest := getattr(found.value, "longest_s", np.inf)):
            problem = f"field lengths_s: {found.name} is sampled, for at most {longest:g} s"
            raise InputError(f"Task: {problem}, got {self.lengths}; make it a NamedTuple, which may be longer")
        return found

    def _scenario(self, motion: Any, ranges: Any, lengths: Any, share: float, plants: int = 1) -> Any:
        ends = np.array([np.min(ranges), np.max(ranges)]), np.array([lengths[0], lengths[-1]])
        swing = self.max_speed_m_s, np.sqrt(self.rise_m / self.curvature_1_m), self.rise_m
        rest: Any = self.lateral_m, self.height_m, swing, self.curvature_1_m, np.array(self.start), float(plants)
        return single_precision(Scenario(motion, *ends, self.short_share, share, *rest))


TaskLike = Task | str | Path | Callable[..., Any]
"""A task as every verb takes it; see `Task.of`."""
