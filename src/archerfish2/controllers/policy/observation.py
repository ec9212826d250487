"""What a policy sees and how it acts: an observation is a list of blocks of numbers, an action an offset from an aim.

Kinds of observation are lists of blocks. `paper`: the six numbers of the paper. `history`: the last decisions, scaled
and differenced; raw ones are the same facts in a form that a small network hardly learns from. Both aim at the latest
detection. `tracked`: a Kalman filter's estimate and a second of history, for a camera and a link that are late and
noisy. `multimodel`: several trackers side by side and longer memories, for targets that move in any way, since no one
tracker fits a target that may stand, drive on, turn back or swing. These two aim at where the filter that follows turns
takes the target to be now, and the command is the next one on the fastest slew to what the action asks for.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, NamedTuple

import numpy as np
from msgspec import Meta

from archerfish2.arrays import Array, lift, map_arrays, namespace, select, single_precision, tree
from archerfish2.controllers.policy.blocks import KINDS, Block
from archerfish2.dynamics.aiming import aim_at
from archerfish2.dynamics.muzzle import Muzzle
from archerfish2.dynamics.slew import approach
from archerfish2.errors import InputError
from archerfish2.plugins import find_plugin
from archerfish2.protocols import Base, Command, Seen, aim, seen_ahead
from archerfish2.records.record import Struct
from archerfish2.robot import Robot
from archerfish2.task import Task
from archerfish2.tracking.detections import azimuth_near, level_distance, unwrapped
from archerfish2.tracking.interacting_models import ModelRates
from archerfish2.tracking.kalman_filter import TrackerNoise, against_pivot, noise_from_record, position_after
from archerfish2.tracking.legendre_memory import Window, constant_history, legendre_window, with_sample
from archerfish2.tracking.side_by_side import Trackers, Tracks

FRAMES, DETECTIONS = 4, 8
"""Decisions and raw detections that are remembered."""
WINDOWS = ((12, 1.0), (6, 1.0), (14, 3.0))
"""Legendre coefficients and length [s] of the histories of azimuth, distance, and azimuth for long."""
ACTION_SCALES = {"box": (0.1, 0.3), "gate": (0.03, 0.1), "los-2deg": (0.03, 0.1)}
"""Command limit → offset of the command from the aim per unit of action, pitch and yaw [rad]: wide where the command
may overdrive the gimbal, narrow where it can't, so that exploration does not dominate the last milliradians."""
ACCELERATION, SLOW_ACCELERATION = {"tracked": 3.0, "multimodel": 4.0}, 0.2
"""What the trackers assume of a target's acceleration, as a standard deviation [m/s²]."""
EXACT_SD = 5e-4
"""What they assume of a camera without noise [m]."""
RATES = ModelRates(*(np.asarray(each) for each in (0.25, 0.1, 0.5)))
"""Of the interacting models: turns and stops [1/s], share of the targets that stand at first."""
_Positive = Annotated[float, Meta(gt=0.0, le=1e6)]
_Magnitude = Annotated[float, Meta(ge=0.0, le=1e3)]
_Offset = Annotated[float, Meta(ge=-1.0, le=1.0)]
_Deviation = Annotated[float, Meta(ge=1e-4, le=0.03)]
_Share = Annotated[float, Meta(ge=0.0, le=1.0)]


class TrackerFacts(Struct, frozen=True, kw_only=True):
    """What the trackers assume, as `TrackerNoise`."""

    acceleration: _Magnitude  # [m/s²]
    along: _Deviation  # [m]
    across: _Deviation  # [m]
    along_share: _Share  # of the distance
    across_angle: _Share  # [rad]
    initial_speed: _Magnitude  # [m/s]
    height_angle: _Share | None = None  # [rad]; of an older policy `across_angle`


class ObserverFacts(Struct, frozen=True, kw_only=True):
    """All numbers of an observer, as a policy's file has them."""

    observation: Annotated[tuple[str, ...], Meta(min_length=1, max_length=100)]
    """A kind of observation, and blocks of a user's own."""
    frames: Annotated[int, Meta(ge=2, le=64)] = FRAMES
    """Decisions that are remembered."""
    period_s: Annotated[float, Meta(ge=1e-4, le=10.0)]
    """Decision period [s]."""
    action_scale: tuple[_Positive, _Positive]
    """Offset of the command from the aim per unit of action, pitch and yaw [rad]."""
    largest_move: tuple[_Positive, _Positive]
    """Of the command from one decision to the next, pitch and yaw [rad]."""
    braking: tuple[_Positive, _Positive]
    """By how much that move may change from one decision to the next, pitch and yaw [rad]."""
    speed: Annotated[float, Meta(ge=2.0, le=1e3)]
    """Of the pellets at the muzzle [m/s]."""
    drag: _Magnitude
    """[1/m]."""
    length: _Magnitude
    """From the pivot to the muzzle [m]."""
    offset: tuple[_Offset, _Offset]
    """Mean disturbance angles, pitch and yaw [rad]."""
    tracker: TrackerFacts | None = None
    """None for an observation without."""


class Decisions(NamedTuple):
    """Of the last decisions, the newest last, shapes B + (frames, ...); of one, without that axis."""

    angle: Array  # of the gimbal [rad], (2,)
    command: Array  # in force [rad], (2,)
    aim: Array  # pitch, yaw [rad] and distance [m] of the latest detection, (3,); None with trackers


class Detections(NamedTuple):
    """The latest detection at the last decisions, the newest last, B + (detections,); of one, without that axis."""

    azimuth: Array  # [rad]
    distance: Array  # on level ground [m]


class Memory(NamedTuple):
    """What is remembered between decisions."""

    tracks: Tracks
    decisions: Decisions
    detections: Any  # Detections; None without trackers
    histories: tuple[Array, ...]  # Legendre coefficients, B + (d,) each
    gimbal_age: Array  # of the latest feedback [s], B
    base: Base  # now
    clock: Array  # since the first decision [s], B


@dataclass(frozen=True, eq=False)
class View:
    """A decision as the blocks need it; tracks are relative to the own pivot and its velocity."""

    memory: Memory
    aim: Array  # at the target as estimated now [rad], B + (2,)
    relative: Array  # that estimate, against the own pivot [m], B + (3,)
    fast: Any  # Track
    slow: Any  # Track

    @cached_property
    def distance(self) -> Array:
        """Distance of the target, on level ground with trackers, of its latest detection without [m], B + (1,)."""
        if self.fast is None:
            return self.memory.decisions.aim[..., -1, 2:]
        return level_distance(self.relative)[..., None]

    @cached_property
    def azimuth(self) -> Array:
        """Azimuth of the target, nearest to that of its latest detection, or to the command's yaw [rad], B + (1,)."""
        detections, command = self.memory.detections, self.memory.decisions.command
        near = command[..., -1, 1] if detections is None else detections.azimuth[..., -1]
        return azimuth_near(self.relative, near)[..., None]

    @cached_property
    def direction(self) -> Array:
        """Unit vector to the target on level ground, B + (2,)."""
        return self.relative[..., :2] / level_distance(self.relative)[..., None]

    def across(self, level: Array) -> Array:
        """Return the part of a level vector to the left of the line of sight, shape B + (2,) → B + (1,)."""
        return self.direction[..., :1] * level[..., 1:] - self.direction[..., 1:] * level[..., :1]

    def away(self, level: Array) -> Array:
        """Return the part of a level vector along the line of sight, shape B + (2,) → B + (1,)."""
        return namespace(level).sum(self.direction * level, axis=-1, keepdims=True)

    def unwrapped(self, angle: Array) -> Array:
        """Return pitch and yaw [rad] with the yaw nearest to that of the command, shape B + (2,)."""
        return unwrapped(angle, self.memory.decisions.command[..., -1, :])


@tree(static=("blocks", "frames"))
class Observer:
    """How a policy sees and acts; the same in NumPy on a robot and inside a compiled training."""

    blocks: tuple[Block, ...]  # of the observation
    trackers: Trackers
    windows: tuple[Window, ...]  # of azimuth, distance, azimuth for long
    frames: int  # decisions that are remembered
    action_scale: Array  # offset from the aim per unit of action, pitch and yaw [rad], (2,)
    largest_move: Array  # of the command from one decision to the next, pitch and yaw [rad], (2,)
    braking: Array  # by how much that move may change, pitch and yaw [rad], (2,)
    muzzle: Muzzle  # that the aim is computed for

    def begin(self, seen: Seen) -> Memory:
        """Return the memory at the first decision, as if nothing had moved before it; shape B."""
        xp, tracks, zero = namespace(seen.command), self.trackers.begin(seen), 0.0 * seen.elapsed
        decision, detection = self._decision(tracks, seen), self._detection(tracks, zero)

        def repeated(each: Any, count: int) -> Any:
            return map_arrays(lambda array: xp.stack([array] * count, axis=zero.ndim), each)

        decisions, detections = repeated(decision, self.frames), repeated(detection, DETECTIONS)
        samples = detection and zip(self.windows, (*detection, detection.azimuth), strict=False)
        histories = tuple(constant_history(*each) for each in samples or ())
        return Memory(tracks, decisions, detections, histories, seen.gimbal.age, seen.base, zero)

    def remember(self, memory: Memory, seen: Seen) -> Memory:
        """Update the memory with what is seen at a decision, the first one included; shape B."""
        xp, later = namespace(seen.command), seen.elapsed > 0.0
        tracks = self.trackers.update(memory.tracks, seen)
        before = memory.detections and memory.detections.azimuth[..., -1]
        decision, detection = self._decision(tracks, seen), self._detection(tracks, before)
        batch = (slice(None),) * later.ndim

        def pushed(series: Array, newest: Array) -> Array:
            return xp.concat([series[(*batch, slice(1, None))], newest[(*batch, None)]], axis=later.ndim)

        old: Any = (memory.decisions, memory.detections, memory.histories)
        samples = detection and zip(self.windows, memory.histories, (*detection, detection.azimuth), strict=False)
        histories = tuple(with_sample(*each) for each in samples or ())
        new = (*map_arrays(pushed, old[:2], (decision, detection)), histories)
        return Memory._make((tracks, *select(later, new, old), seen.gimbal.age, seen.base, memory.clock + seen.elapsed))

    def view(self, memory: Memory) -> View:
        """Return the decision as the blocks need it; shape B."""
        tracks, base = memory.tracks, memory.base
        if tracks.fast is None:
            return View(memory, memory.decisions.aim[..., -1, :2], tracks.place - base.position, None, None)
        fast, slow = (each and against_pivot(each, base, tracks.age) for each in (tracks.fast, tracks.slow))
        relative = position_after(fast, tracks.age)
        angle = unwrapped(aim_at(relative, self.muzzle).angle, memory.decisions.command[..., -1, :])
        return View(memory, angle, relative, fast, slow)

    def observe(self, view: View) -> Array:
        """Return the observation, shape B + (n,)."""
        return namespace(view.aim).concat([block(self, view) for block in self.blocks], axis=-1)

    def decode(self, view: View, action: Array) -> Command:
        """Turn an action, shape B + (2,), into a command; zero aims at the target as estimated now."""
        wanted = view.aim + lift(self.action_scale, action) * action
        if self.trackers.fast is None:
            return aim(wanted)
        return aim(approach(wanted, view.memory.decisions.command[..., -1, :], self.largest_move, self.braking, 1.0))

    def layout(self) -> list[tuple[str, int]]:
        """Return name and size of the blocks, in order; in NumPy, with an observer of NumPy's arrays.

        Raises:
          InputError: if a block of a user's own fails, or returns another shape, or numbers that are not finite.
        """
        seen, sizes = seen_ahead(2), []
        memory = self.begin(seen)
        for elapsed in (0.0, *[0.02] * 4):
            memory = self.remember(memory, seen._replace(elapsed=seen.elapsed + np.float32(elapsed)))
        if not np.all(np.isfinite(self.decode(self.view(memory), 0.0 * seen.command).angle)):
            raise InputError("the observer gives commands that are not finite; train again")
        for block in self.blocks:
            plugin = find_plugin(block, "block")
            with plugin.running():
                numbers = np.asarray(block(self, self.view(memory)))
                if numbers.shape[:-1] != (2,) or numbers.dtype.kind != "f" or not np.all(np.isfinite(numbers)):
                    found = f"{numbers.dtype} of shape {numbers.shape}"
                    raise InputError(f"returns {found} for a batch (2,), expected finite floats, (2, k); correct it")
            sizes.append((plugin.name, numbers.shape[-1]))
        return sizes

    def _decision(self, tracks: Tracks, seen: Seen) -> Decisions:
        if self.trackers.fast is not None:
            return Decisions(seen.gimbal.angle, seen.command, None)
        xp, relative = namespace(seen.command), tracks.place - seen.base.position
        angle = unwrapped(aim_at(relative, self.muzzle).angle, seen.command)
        distance = xp.sqrt(xp.sum(relative**2, axis=-1, keepdims=True))
        return Decisions(seen.gimbal.angle, seen.command, xp.concat([angle, distance], axis=-1))

    def _detection(self, tracks: Tracks, azimuth: Array) -> Detections | None:
        """Return the latest detection as the own pivot saw it, with the azimuth nearest to an earlier one, shape B."""
        if self.trackers.fast is None:
            return None
        relative = tracks.place - tracks.own
        return Detections(azimuth_near(relative, azimuth), level_distance(relative))


def observer_facts(observation: str | tuple[str, ...], robot: Robot, task: Task, frames: int = FRAMES) -> ObserverFacts:
    """Return all numbers of the observer of a robot for a task.

    Args:
      observation: a kind of observation, or one followed by names of blocks of a user's own, as `find_plugin` takes
        them.
      robot: muzzle, camera and limits.
      task: decision period and command limit.
      frames: decisions that are remembered; `paper` has two.

    Raises:
      InputError: if the kind is unknown, or needs a sensing record that the robot lacks.
    """
    kind, *own = (observation,) if isinstance(observation, str) else observation or ("",)
    if kind not in KINDS:
        raise InputError(f"observation must be one of {', '.join(KINDS)}, got {kind!r}; then blocks of your own")
    tracker = None
    if kind in ACCELERATION:
        if robot.sensing is None and kind == "tracked":
            raise InputError("observation tracked needs a robot with sensing.json; identify it, or take history")
        noise = TrackerNoise(ACCELERATION[kind], EXACT_SD, EXACT_SD)
        noise = noise if robot.sensing is None else noise_from_record(robot.sensing, ACCELERATION[kind])
        tracker = TrackerFacts(**{name: float(value) for name, value in noise._asdict().items()})
    limits, muzzle, period = robot.command_limits(task), robot.muzzle_model(), task.period_s
    return ObserverFacts(
        observation=(kind, *own),
        frames=2 if kind == "paper" else frames,
        period_s=period,
        action_scale=ACTION_SCALES[task.command_limit],
        largest_move=tuple(limits.max_rate * period),
        braking=tuple(limits.max_acceleration * period**2),
        tracker=tracker,
        offset=tuple(muzzle.offset),
        **{name: float(getattr(muzzle, name)) for name in ("speed", "drag", "length")},
    )


def make_observer(facts: ObserverFacts, blocks: tuple[Any, ...] = ()) -> Observer:
    """Build an observer in float32.

    Args:
      facts: its numbers.
      blocks: of a user's own, names or functions, in the order of the facts.

    Raises:
      InputError: if there are other blocks than the facts name.
    """
    kind, *names = facts.observation
    if kind not in KINDS or (kind in ACCELERATION) != (facts.tracker is not None):
        raise InputError(f"observation: expected one of {', '.join(KINDS)}, with its tracker, got {kind}; correct it")
    if len(names) != len(blocks):
        remedy = f"give {', '.join(names)}" if names else "leave them out"
        raise InputError(f"observation {kind} has {len(names)} blocks of a user's own, got {len(blocks)}; {remedy}")
    trackers, windows = Trackers(), tuple[tuple[int, float], ...]()
    if facts.tracker is not None:
        values = (getattr(facts.tracker, name) for name in TrackerNoise._fields)
        fast = TrackerNoise(*(np.asarray(facts.tracker.across_angle if value is None else value) for value in values))
        trackers, windows = Trackers(fast), WINDOWS[:1]
    if kind == "multimodel":
        trackers, windows = Trackers(fast, fast._replace(acceleration=np.asarray(SLOW_ACCELERATION)), RATES), WINDOWS
    muzzle = (facts.speed, 0.0, facts.offset, (0.0, 0.0), facts.drag, facts.length)
    observer: Observer = Observer(
        blocks=(*KINDS[kind], *(find_plugin(each, "block").value for each in blocks)),
        trackers=trackers,
        windows=tuple(legendre_window(order, length, facts.period_s) for order, length in windows),
        frames=facts.frames,
        action_scale=np.array(facts.action_scale),
        largest_move=np.array(facts.largest_move),
        braking=np.array(facts.braking),
        muzzle=Muzzle(*(np.array(each) for each in muzzle)),
    )
    return single_precision(observer)
