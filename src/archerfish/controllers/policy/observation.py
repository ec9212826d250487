"""Observations of a policy by kind, as lists of blocks, and the observer that is built for a robot and a task.

`paper`: the six numbers of the paper. `history`: the last decisions, scaled and differenced; raw ones are the same
facts in a form that a small network hardly learns from. `tracked`: a Kalman filter's estimate and a second of history,
for a camera and a link that are late and noisy. `multimodel`: several trackers side by side and longer memories, for
targets that move in any way, since no one tracker fits a target that may stand, drive on, turn back or swing.
"""

from typing import Annotated, Any

import numpy as np
from msgspec import Meta, structs

from archerfish.arrays import single_precision
from archerfish.controllers.policy.blocks import OBSERVATIONS
from archerfish.controllers.policy.observer import Observer
from archerfish.dynamics.muzzle import Muzzle
from archerfish.errors import InputError, meant
from archerfish.plugins import find_plugin
from archerfish.records.record import Share, Struct
from archerfish.robot import Robot
from archerfish.task import Task
from archerfish.tracking.interacting_models import ModelRates
from archerfish.tracking.kalman_filter import TrackerNoise, noise_from_record
from archerfish.tracking.legendre_memory import legendre_window
from archerfish.tracking.side_by_side import Trackers

FRAMES = 4
"""Decisions that are remembered."""
WINDOWS: tuple[tuple[int, float], ...] = ((12, 1.0), (6, 1.0), (14, 3.0))
"""Legendre coefficients and length [s] of the histories of azimuth, distance, and azimuth for long."""
ACTION_SCALES = {"box": (0.1, 0.3), "gate": (0.03, 0.1), "los-2deg": (0.03, 0.1)}
"""Command limit → offset of the command from the aim per unit of action, pitch and yaw [rad]: wide where the command
may overdrive the gimbal, narrow where it can't, so that exploration does not dominate the last milliradians."""
ACCELERATION, SLOW_ACCELERATION = {"tracked": 3.0, "multimodel": 4.0}, 0.2
"""What the trackers assume of a target's acceleration, as a standard deviation [m/s²]."""
TRACKERS_EXACT_SD = 5e-4
"""What they assume of detections by a camera without noise, as a standard deviation [m]."""
TURNS_PER_S = 0.25
"""How often the interacting models assume that a target turns back [1/s]."""
_Positive = Annotated[float, Meta(gt=0.0, le=1e6)]
_Magnitude = Annotated[float, Meta(ge=0.0, le=1e3)]
_Offset = Annotated[float, Meta(ge=-1.0, le=1.0)]
_Deviation = Annotated[float, Meta(ge=1e-4, le=0.03)]


class TrackerFacts(Struct, frozen=True, kw_only=True):
    """What the trackers assume, as `TrackerNoise`."""

    acceleration: _Magnitude  # [m/s²]
    along: _Deviation  # [m]
    across: _Deviation  # [m]
    along_share: Share  # of the distance
    across_angle: Share  # [rad]
    initial_speed: _Magnitude  # [m/s]
    height_angle: Share | None = None  # [rad]; of an older policy `across_angle`


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
    if kind not in OBSERVATIONS:
        remedy = meant(str(kind), OBSERVATIONS, "name one, then blocks of your own")
        raise InputError(f"observation must be one of {', '.join(OBSERVATIONS)}, got {kind!r}; {remedy}")
    tracker = None
    if kind in ACCELERATION:
        if robot.sensing is None and kind == "tracked":
            raise InputError("observation tracked needs a robot with sensing.json; identify it, or take history")
        noise = noise_from_record(robot.sensing, ACCELERATION[kind], TRACKERS_EXACT_SD)
        tracker = TrackerFacts(**noise._asdict())
    limits, muzzle, period = robot.command_limits(task), robot.muzzle, task.period_s
    return ObserverFacts(
        observation=(kind, *own),
        frames=2 if kind == "paper" else frames,
        period_s=period,
        action_scale=ACTION_SCALES[task.command_limit],
        largest_move=tuple(limits.max_rate * period),
        braking=tuple(limits.max_acceleration * period**2),
        tracker=tracker,
        speed=muzzle.speed,
        drag=muzzle.drag,
        length=muzzle.length,
        offset=(muzzle.pitch_offset, muzzle.yaw_offset),
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
    if kind not in OBSERVATIONS or (kind in ACCELERATION) != (facts.tracker is not None):
        raise InputError(
            f"observation: expected one of {', '.join(OBSERVATIONS)}, with its tracker, got {kind}; correct it"
        )
    if len(names) != len(blocks):
        remedy = f"give {', '.join(names)}" if names else "leave them out"
        raise InputError(f"observation {kind} has {len(names)} blocks of a user's own, got {len(blocks)}; {remedy}")
    trackers, windows = Trackers(), WINDOWS[:0]
    if facts.tracker is not None:
        fast = TrackerNoise(**structs.asdict(facts.tracker))
        if fast.height_angle is None:
            fast = fast._replace(height_angle=fast.across_angle)
        trackers, windows = Trackers(fast), WINDOWS[:1]
    if kind == "multimodel":
        slow = fast._replace(acceleration=SLOW_ACCELERATION)
        trackers, windows = Trackers(fast, slow, ModelRates(TURNS_PER_S)), WINDOWS
    muzzle = Muzzle(facts.speed, 0.0, np.array(facts.offset), np.zeros(2), facts.drag, facts.length)
    observer: Observer = Observer(
        blocks=(*OBSERVATIONS[kind], *(find_plugin(block, "block").value for block in blocks)),
        trackers=trackers,
        windows=tuple(legendre_window(order, length, facts.period_s) for order, length in windows),
        frames=facts.frames,
        action_scale=np.array(facts.action_scale),
        largest_move=np.array(facts.largest_move),
        braking=np.array(facts.braking),
        muzzle=muzzle,
    )
    return single_precision(observer)
