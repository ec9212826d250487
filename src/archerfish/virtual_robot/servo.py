"""Firmware, motors and mechanics together, tick by tick: the closed loop of a batch of gimbals."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from archerfish.virtual_robot.description import TICK_S, RobotDescription
from archerfish.virtual_robot.firmware import (
    Drive,
    encoder_angle,
    filtered_rate,
    firmware_torque,
    make_drive,
    motor_torque,
)
from archerfish.virtual_robot.mujoco_gimbal import MujocoGimbal
from archerfish.virtual_robot.noise import NoiseStream

Array = NDArray[np.float64]


class Motion(NamedTuple):
    """What the gimbals did in n ticks."""

    angle: Array  # true, at the beginning of each tick and at the end of the last [rad], (n + 1, B, 2)
    gyro: Array  # filtered, at the beginning of each tick [rad/s], (n, B, 2)


class GimbalServo(Protocol):
    """What follows commands: the closed loop of B gimbals."""

    drive: Drive
    """Its command range, and its encoder."""
    torque: Array
    """Of the motors over the last tick [N·m], (B, 2)."""

    @property
    def angle(self) -> Array:
        """True pitch and yaw [rad], shape (B, 2)."""

    @property
    def rate(self) -> Array:
        """True rates [rad/s], shape (B, 2)."""

    def reset(self, command: Array) -> None:
        """Put the gimbals at rest where a command [rad] holds them, shape (B, 2)."""

    def kick(self, fired: NDArray[np.bool_]) -> None:
        """Let the recoil of a shot act in the next tick on those that fired, shape (B,)."""

    def run(self, commands: Array) -> Motion:
        """Run n ticks under the commands in force in each, within the servo's range [rad], shape (n, B, 2)."""


class Servo:
    """The closed loop of B gimbals in MuJoCo; `reset` must follow."""

    def __init__(self, robot: RobotDescription, seeds: NDArray[np.int64]) -> None:
        self.drive = make_drive(robot, len(seeds))
        self.physics = MujocoGimbal(robot.gimbal, len(seeds))
        self._recoil_per_shot = np.array([robot.gimbal.pitch.recoil_n_m_s, robot.gimbal.yaw.recoil_n_m_s])
        self._bus_ticks = robot.firmware.bus_delay_ms
        self._seeds = seeds

    @property
    def angle(self) -> Array:
        """True pitch and yaw [rad], shape (B, 2)."""
        return self.physics.angle

    @property
    def rate(self) -> Array:
        """True rates [rad/s], shape (B, 2)."""
        return self.physics.rate

    def reset(self, command: Array) -> None:
        """Put the gimbals at rest where a command [rad] holds them, shape (B, 2)."""
        drive = self.drive
        self.physics.reset(drive.angle_per_encoder * command)
        held = self.physics.holding_torque()
        self.torque = np.clip(held, -drive.torque_limit, drive.torque_limit)
        self._integral = np.clip(held, -drive.integral_limit, drive.integral_limit)
        self._gyro = np.zeros_like(command)
        self._on_bus = [self.torque] * self._bus_ticks
        self._recoil: Array | float = 0.0
        self._noise = NoiseStream(self._seeds, "gyro")
        self._tick = 0

    def kick(self, fired: NDArray[np.bool_]) -> None:
        """Let the recoil of a shot act in the next tick on those that fired, shape (B,)."""
        self._recoil = self._recoil + fired[:, None] * self._recoil_per_shot / TICK_S

    def run(self, commands: Array) -> Motion:
        """Run n ticks under the commands in force in each, within the firmware's range [rad], shape (n, B, 2)."""
        count, physics, drive = len(commands), self.physics, self.drive
        normals = self._noise.rows(self._tick, count).swapaxes(0, 1)
        self._tick += count
        angle, gyro = np.empty((count + 1, *commands.shape[1:])), np.empty(commands.shape)
        angle[0] = physics.angle
        for tick in range(count):
            rate = physics.rate
            self._gyro = gyro[tick] = filtered_rate(drive, self._gyro, rate, normals[tick])
            encoder = encoder_angle(drive, angle[tick])
            self._integral, requested = firmware_torque(drive, self._integral, commands[tick], encoder, self._gyro)
            self._on_bus.append(requested)
            self.torque = motor_torque(drive, self.torque, self._on_bus.pop(0), rate)
            physics.step(self.torque + self._recoil)
            self._recoil = 0.0
            angle[tick + 1] = physics.angle
        return Motion(angle, gyro)
