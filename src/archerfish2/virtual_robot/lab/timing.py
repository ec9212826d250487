"""The recordings of docs/sensing.md: a plate at rest while the yaw sweeps, then command steps and target steps."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish2.errors import InputError
from archerfish2.virtual_robot.batch import RobotBatch
from archerfish2.virtual_robot.description import TICK_S, RobotDescription
from archerfish2.virtual_robot.lab.recorder import Advance, Session, Stamps, Trace, play, receipt_trace, robot_trace
from archerfish2.virtual_robot.lab.signals import REST_S

Array = NDArray[np.float64]

_OF_THE_REACH = 0.8


@dataclass(frozen=True)
class TimingPlan:
    """What is done."""

    sweep_s: float = 20.0
    """Length of the yaw sweep [s]."""
    amplitude: float = float(np.radians(15.0))
    """Of the yaw sweep [rad]."""
    low_hz: float = 0.2
    """First frequency of the sweep; it must change, since one that repeats itself fits at several offsets."""
    high_hz: float = 2.0
    """Last frequency."""
    steps: int = 20
    """Number of command steps, and of target steps."""
    step: float = float(np.radians(7.0))
    """Size of the command steps [rad]."""
    distance: float = 4.0
    """Distance of the plate [m]: far, where its noise costs most hits."""
    target_step: float = 0.3
    """Size of the target's steps, sideways [m]."""

    def __post_init__(self) -> None:
        for name in ("sweep_s", "amplitude", "low_hz", "high_hz", "step", "distance", "target_step"):
            if not 0 < getattr(self, name) < np.inf:
                raise InputError(f"timing.{name} must be > 0, got {getattr(self, name):g}")
        if self.steps < 1:
            raise InputError(f"timing.steps must be at least 1, got {self.steps}")


def timing_plan(robot: RobotDescription) -> TimingPlan:
    """Return the plan for a robot: the usual one, with smaller turns where its yaw goes less far."""
    yaw = robot.limits.yaw
    reach = _OF_THE_REACH * float(np.radians(min(-yaw.low_deg, yaw.high_deg)))
    usual = TimingPlan()
    return replace(usual, amplitude=min(usual.amplitude, reach), step=min(usual.step, reach))


class Detected(NamedTuple):
    """Detections of a plate that was found."""

    stamp: Array
    """On the camera's clock [s], shape (K,)."""
    received: Array
    """[s], shape (K,)."""
    position: Array
    """In the camera's frame [m], shape (K, 3)."""


class TimingLogs(NamedTuple):
    """All logs of a timing recording."""

    sweep: Trace
    """Gimbal while the yaw sweeps."""
    plate: Detected
    """The plate at rest, seen meanwhile."""
    steps: Trace
    """Gimbal during command steps, and at rest during target steps."""
    target: Detected
    """The stepping target, seen by the resting gimbal."""
    moments: Array
    """Moments of its steps [s], shape (steps,)."""
    commands: tuple[Array, Array]
    """When commands were sent, and received by the robot [s], shape (C,) each."""
    reports: tuple[Array, Array]
    """When reports of the gimbal were stamped by the robot, and received by the host [s], shape (R,) each."""


class SteppingTarget:
    """A plate that jumps to and fro sideways at known moments."""

    def __init__(self, distance: float, size: float, moments: Array) -> None:
        self._distance = distance
        self._size = size
        self._moments = moments

    def position(self, time: Array) -> Array:
        """Return its position [m] at times [s], shape (B,) → (B, 3)."""
        side = np.searchsorted(self._moments, time, side="right") % 2 - 0.5
        return np.stack([self._distance + 0.0 * side, self._size * side, 0.0 * side], axis=-1)


def record_timing(robot: RobotBatch, plan: TimingPlan, stamps: Stamps, seed: int, advance: Advance) -> TimingLogs:
    """Record both parts over the link.

    Args:
      robot: batch of one.
      plan: what is done.
      stamps: whose stamps the gimbal logs have: the robot's, or the host's at the receipt of each report. Commands are
        logged when the host sends them.
      seed: of the irregular intervals between the target's steps.
      advance: is told how many seconds have been played.

    Raises:
      InputError: if the robot can't turn that far.
    """
    yaw = robot.description.limits.yaw
    for asked in (plan.amplitude, plan.step):
        if not np.radians(yaw.low_deg) <= -asked <= asked <= np.radians(yaw.high_deg):
            raise InputError(
                f"timing turns the yaw by ±{np.degrees(asked):g}°, beyond the robot's limits {yaw.low_deg:g}…"
                f"{yaw.high_deg:g}°; ask for less"
            )
    sweep, begun = _yaw_sweep(plan), _yaw_steps(plan)
    resting = SteppingTarget(plan.distance, 0.0, np.empty(0))
    swept = _played(robot, resting, sweep, advance)
    moments = _moments(len(begun) * TICK_S, plan.steps, seed)
    rest = np.zeros((round((moments[-1] + 1.0) / TICK_S) - len(begun), 2))
    stepped = _played(
        robot,
        SteppingTarget(plan.distance, plan.target_step, moments),
        np.concatenate([begun, rest]),
        lambda done: advance(len(sweep) * TICK_S + done),
    )
    target = _detected(stepped, after=len(begun) * TICK_S)
    received = stepped.received
    return TimingLogs(
        _trace(swept, stamps),
        _detected(swept),
        _trace(stepped, stamps),
        target,
        moments,
        (received.commands.sent_s, received.commands.received_s),
        (received.feedback.sampled_s, received.feedback.received_s),
    )


def timing_length(plan: TimingPlan) -> float:
    """Return about how long all of it takes [s]."""
    return plan.sweep_s + 2 * REST_S + plan.steps * (0.6 + 1.2) + 3.0


def _yaw_sweep(plan: TimingPlan) -> Array:
    time = TICK_S * np.arange(round(plan.sweep_s / TICK_S))
    cycles = plan.low_hz * time + 0.5 * (plan.high_hz - plan.low_hz) * time**2 / plan.sweep_s
    rest = np.zeros(round(REST_S / TICK_S))
    return _yaw(np.concatenate([rest, plan.amplitude * np.sin(2.0 * np.pi * cycles), rest]))


def _yaw_steps(plan: TimingPlan) -> Array:
    levels = plan.step * (np.arange(plan.steps) % 2 == 0)
    rest = np.zeros(round(REST_S / TICK_S))
    # The last step must have settled before the target begins to step.
    return _yaw(np.concatenate([rest, np.repeat(levels, round(0.6 / TICK_S)), np.repeat(rest, 3)]))


def _yaw(angle: Array) -> Array:
    return np.stack([0.0 * angle, angle], axis=-1)


def _moments(start: float, count: int, seed: int) -> Array:
    """Return the moments of the target's steps: about a second apart, at all phases of the frames."""
    return start + np.cumsum(np.random.default_rng(seed).uniform(0.9, 1.1, count))


def _played(robot: RobotBatch, target: SteppingTarget, commands: Array, advance: Advance) -> Session:
    robot.reset(np.zeros((1, 2)), target)
    return play(robot, commands, "link", advance)


def _trace(session: Session, stamps: Stamps) -> Trace:
    start = np.zeros(2)
    return receipt_trace(session, start) if stamps == "host" else robot_trace(session, start, as_sent=True)


def _detected(session: Session, after: float = -np.inf) -> Detected:
    frames = session.received.detections
    kept = frames.found[:, 0] & (frames.received_s > after)
    return Detected(frames.exposed_s[kept], frames.received_s[kept], frames.position[kept, 0])
