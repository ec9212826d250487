"""A robot of identified records: the plants of its gimbal at 1 kHz, with the camera, link and muzzle of the records.

It needs no MuJoCo. It is the robot as a policy's training simulates it. What the records don't have is not in it:
friction, saturation of the motors, recoil, droop of the muzzle speed.
"""

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from archerfish.dynamics.linear_axis import advance, axis_of, gimbal_angle, gimbal_model, refined, rest_state
from archerfish.errors import InputError
from archerfish.records.plant import PlantRecord
from archerfish.robot import Robot
from archerfish.virtual_robot.description import (
    TICK_S,
    Camera,
    Link,
    MuzzleTable,
    RefereeTable,
    RobotDescription,
    Schema,
)
from archerfish.virtual_robot.description_file import load_robot
from archerfish.virtual_robot.firmware import Drive
from archerfish.virtual_robot.noise import NoiseStream
from archerfish.virtual_robot.servo import Motion

Array = NDArray[np.float64]
IDENTIFIED = "identified"
"""Name of the robot of the records."""
Table = TypeVar("Table")
_LONGEST_TICKS = 100  # of a step of the model
_LARGEST_HZ = 1.0 / TICK_S
_GYRO_NOISE = 0.003  # no record has it; without any, the frames of a gimbal at rest would be equal [rad/s]
_OPENING_DEG = 179.0  # no record has the field of view


class IdentifiedServo:
    """The linear axes of a robot's records in the place of firmware, motors and mechanics; `reset` must follow.

    The model makes a step each tick. Where a plant can't be divided into ticks, it makes one each sampling period, and
    the angle is linear in between.
    """

    def __init__(self, robot: Robot, seeds: NDArray[np.int64]) -> None:
        pitch, yaw = _in_ticks(robot.pitch), _in_ticks(robot.yaw)
        periods = [plant.sample_period_s / TICK_S for plant in (pitch, yaw)]
        steps = (step for step in range(1, _LONGEST_TICKS) if all(_is_whole(step / period) for period in periods))
        self._step = next(steps, _LONGEST_TICKS)  # one that suits neither plant is refused by the model
        self._model = gimbal_model(pitch, yaw, self._step * TICK_S)
        self._seeds, zero = seeds, np.zeros((len(seeds), 2))
        low, high = np.transpose([robot.limits.pitch.ends, robot.limits.yaw.ends])
        # Of a drive the links need no more than the range of its commands.
        self.drive = Drive(*[zero] * len(Drive._fields))._replace(command_low=zero + low, command_high=zero + high)

    def reset(self, command: Array) -> None:
        """Put the gimbals at rest under a command [rad], shape (B, 2)."""
        self._state = rest_state(self._model, command)
        self.angle = self._begin = self._end = gimbal_angle(self._model, self._state)
        self.rate = self.torque = np.zeros_like(command)
        self._noise, self._tick = NoiseStream(self._seeds, "gyro"), 0

    def kick(self, fired: NDArray[np.bool_]) -> None:
        """Do nothing with those that fired, shape (B,): no record has the recoil."""

    def run(self, commands: Array) -> Motion:
        """Run n ticks under the commands in force in each [rad], shape (n, B, 2)."""
        angle, gyro = np.empty((len(commands) + 1, *commands.shape[1:])), np.empty(commands.shape)
        angle[0] = self.angle
        normals = self._noise.rows(self._tick, len(commands)).swapaxes(0, 1)
        for tick, command in enumerate(commands):
            gyro[tick] = self.rate + _GYRO_NOISE * normals[tick]
            part = self._tick % self._step
            if part == 0:
                self._state = advance(self._model, self._state, command)
                self._begin, self._end = self._end, gimbal_angle(self._model, self._state)
                self.rate = (self._end - self._begin) / (self._step * TICK_S)
            self.angle = angle[tick + 1] = self._begin + (part + 1) / self._step * (self._end - self._begin)
            self._tick += 1
        return Motion(angle, gyro)


def described_by_records(robot: Robot, hit_radius_m: float, camera_m: tuple[float, float, float]) -> RobotDescription:
    """Return what the records say of link, camera and muzzle; the rest is not read beside an `IdentifiedServo`.

    Latencies are uniform, with the mean and the standard deviation of the records. What they lack is zero.

    Args:
      robot: its records.
      hit_radius_m: largest distance from the plate's centre of a hit [m].
      camera_m: place of the camera: forward, left and up from the pivot [m].

    Raises:
      InputError: if the robot has no record of its sensing.
    """
    if robot.sensing is None:
        remedy = "identify its logs of timing, or emulate a virtual robot (--virtual infantry)"
        raise InputError(f"{robot.name} has no sensing.json, so its camera and link can't be emulated; {remedy}")
    sensing, muzzle = robot.sensing, robot.muzzle
    camera, link = sensing.camera, sensing.link
    # A latency that counts from the feedback lacks the feedback's delay to one that counts from the exposure.
    delay = link.feedback_latency if link.feedback_delay is None else link.feedback_delay
    extra = (delay or 0.0) if camera.latency_basis == "feedback" else 0.0
    forward, left, up = camera_m
    return load_robot("infantry").replace(
        schema=Schema(format="archerfish.robot/1", name=IDENTIFIED),
        link=_table(
            Link,
            **_latency("command_latency", link.command_latency, link.command_latency_jitter),
            **_latency("feedback_latency", link.feedback_latency, link.feedback_latency_jitter),
            command_rate_hz=_LARGEST_HZ,
            feedback_rate_hz=min(link.feedback_rate_hz, _LARGEST_HZ),
            feedback_angle_quantum_deg=math.degrees(link.feedback_quantum or 0.0),
            feedback_source="imu",
        ),
        camera=_table(
            Camera,
            **_latency("latency", (camera.latency or 0.0) + extra, camera.latency_jitter),
            forward_m=forward,
            left_m=left,
            up_m=up,
            rate_hz=min(camera.rate_hz, _LARGEST_HZ),
            clock_offset_ms=-1e3 * camera.time_offset,
            stamp_jitter_ms=1e3 * camera.stamp_jitter,
            bearing_sd_mrad=1e3 * camera.bearing_sd,
            elevation_sd_mrad=1e3 * camera.elevation_sd,
            range_sd_percent=100.0 * camera.range_sd / camera.noise_range,
            miss_probability=camera.miss_probability,
            field_of_view_yaw_deg=_OPENING_DEG,
            field_of_view_pitch_deg=_OPENING_DEG,
        ),
        muzzle=_table(
            MuzzleTable,
            forward_m=muzzle.length,
            speed_m_s=muzzle.speed,
            speed_sd_m_s=muzzle.speed_sd,
            droop_recovery_ms=1.0,
            dispersion_pitch_deg=math.degrees(muzzle.pitch_sd),
            dispersion_yaw_deg=math.degrees(muzzle.yaw_sd),
            boresight_pitch_deg=math.degrees(muzzle.pitch_offset),
            boresight_yaw_deg=math.degrees(muzzle.yaw_offset),
            height_m=muzzle.height or 1.0,
            drag_per_m=muzzle.drag,
        ),
        referee=_table(RefereeTable, hit_radius_m=hit_radius_m, max_rate_hz=_LARGEST_HZ, heat_limit=1.0),
    )


def _table(kind: Callable[..., Table], **known: Any) -> Table:
    """Return a table of which the fields that are not known are zero."""
    names: Any = kind
    return kind(**dict.fromkeys(names.__struct_fields__, 0.0) | known)


def _latency(name: str, mean_s: float | None, deviation_s: float | None) -> dict[str, float]:
    """Return the ends of a uniform distribution [ms], none below zero, by the names of their fields."""
    mean = max(mean_s or 0.0, 0.0)
    half = min(math.sqrt(3.0) * (deviation_s or 0.0), mean)
    return {f"{name}_low_ms": 1e3 * (mean - half), f"{name}_high_ms": 1e3 * (mean + half)}


def _in_ticks(plant: PlantRecord) -> PlantRecord:
    """Return the same plant with a sampling period that divides a tick, where it has one."""
    parts = next((parts for parts in range(1, 21) if _is_whole(parts * plant.sample_period_s / TICK_S)), 1)
    axis = refined(axis_of(plant), TICK_S / parts)
    return plant.replace(
        A=axis.a,
        B=axis.b[:, None],
        C=axis.c[None],
        D=np.reshape(axis.d, (1, 1)),
        delay_samples=int(axis.delay),
        sample_period_s=axis.period_s,
        output_names=plant.output_names[:1],
        draws={},
        draw_delays=np.zeros(0, np.int64),
    )


def _is_whole(ratio: float) -> bool:
    return round(ratio) >= 1 and abs(ratio - round(ratio)) <= 1e-6 * ratio
