"""Firmware, motors and mechanics together, tick by tick: the closed loop of a batch of gimbals."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish2.virtual_robot.description import TICK_S, RobotDescription
from archerfish2.virtual_robot.firmware import (
    FirmwareState,
    Gains,
    encoder_angle,
    filtered_rate,
    firmware_torque,
    make_gains,
)
from archerfish2.virtual_robot.motor import Motor, make_motor, motor_torque
from archerfish2.virtual_robot.noise import NoiseStream

if TYPE_CHECKING:
    from archerfish2.virtual_robot.mujoco_gimbal import MujocoGimbal

Array = NDArray[np.float64]


class Motion(NamedTuple):
    """What the gimbals did in n ticks."""

    angle: Array
    """True angles at the beginning of each tick and at the end of the last [rad], shape (n + 1, B, 2)."""
    gyro: Array
    """Filtered gyro at the beginning of each tick [rad/s], shape (n, B, 2)."""


class Servo:
    """The closed loop of B gimbals."""

    def __init__(self, robot: RobotDescription, physics: "MujocoGimbal", seeds: NDArray[np.int64]) -> None:
        # Of the shape of all gimbals: NumPy's loops over two axes would take most of the firmware's time.
        self.gains = Gains(*(np.tile(each, (len(seeds), 1)) for each in make_gains(robot.firmware, robot.gimbal)))
        self.physics = physics
        self._motor = Motor(*(np.tile(each, (len(seeds), 1)) for each in make_motor(robot.gimbal)))
        self._recoil_per_shot = np.array([robot.gimbal.pitch.recoil_n_m_s, robot.gimbal.yaw.recoil_n_m_s])
        self._bus_ticks = robot.firmware.bus_delay_ms
        self._seeds = seeds

    def reset(self, command: Array) -> None:
        """Put the gimbals at rest where a command [rad] holds them, shape (B, 2)."""
        gains = self.gains
        self.physics.reset(gains.angle_per_encoder * command)
        held = self.physics.holding_torque()
        self.torque = np.clip(held, -gains.torque_limit, gains.torque_limit)
        integral = np.clip(held, -gains.integral_limit, gains.integral_limit)
        self._state = FirmwareState(integral, np.zeros_like(command))
        self._on_bus = [self.torque] * self._bus_ticks
        self._recoil: Array | None = None
        self._noise = NoiseStream(self._seeds, "gyro", 2, "normal")
        self._tick = 0

    def kick(self, fired: NDArray[np.bool_]) -> None:
        """Let the recoil of a shot act in the next tick on those that fired, shape (B,)."""
        impulse = fired[:, None] * self._recoil_per_shot / TICK_S
        self._recoil = impulse if self._recoil is None else self._recoil + impulse

    def run(self, commands: Array) -> Motion:
        """Run ticks.

        Args:
          commands: in force in each tick, within the firmware's range [rad], shape (n, B, 2).
        """
        count, physics, gains = len(commands), self.physics, self.gains
        normals = self._noise.rows(self._tick, count)
        angle, gyro = np.empty((count + 1, *commands.shape[1:])), np.empty(commands.shape)
        angle[0] = physics.angle
        for tick in range(count):
            rate = physics.rate
            read = filtered_rate(gains, self._state.gyro, rate, normals[tick])
            encoder = encoder_angle(gains, angle[tick])
            self._state, asked = firmware_torque(gains, self._state, commands[tick], encoder, read)
            self._on_bus.append(asked)
            self.torque = motor_torque(self._motor, self.torque, self._on_bus.pop(0), rate)
            physics.step(self.torque if self._recoil is None else self.torque + self._recoil)
            self._recoil = None
            gyro[tick], angle[tick + 1] = read, physics.angle
        self._tick += count
        return Motion(angle, gyro)
