"""The gimbal's firmware at 1 kHz, angle P → rate PI → torque on an encoder and a gyro, and its motors."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.virtual_robot.description import TICK_S, FirmwareAxis, GimbalAxis, RobotDescription

Array = NDArray[np.float64]


class Drive(NamedTuple):
    """Constants of firmware and motors of B gimbals, pitch and yaw: (B, 2) each."""

    angle_gain: Array  # requested rate per angle error [1/s]
    rate_limit: Array  # largest requested rate [rad/s]
    rate_gain: Array  # torque per rate error [N·m·s/rad]
    integral_gain: Array  # torque per rate error, added in each tick [N·m·s/rad]
    integral_limit: Array  # largest torque of the integral [N·m]
    torque_limit: Array  # largest torque of the motor, by its driver's limit of the current [N·m]
    command_low: Array  # smallest command [rad]
    command_high: Array  # largest command [rad]
    quantum: Array  # step of the encoder [rad]
    angle_per_encoder: Array  # true angle over the encoder's
    gyro_noise: Array  # standard deviation of the gyro [rad/s]
    gyro_gain: Array  # share of the difference to a new reading that the gyro's filter covers in a tick
    current_gain: Array  # share of the difference to the requested torque that the motor covers in a tick
    stall_torque: Array  # of the motor at rest under the full voltage [N·m]
    back_emf: Array  # torque that the motor loses per speed [N·m·s/rad]


def make_drive(robot: RobotDescription, batch: int) -> Drive:
    """Return the constants of B gimbals."""
    pitch = _axis_constants(robot.firmware.pitch, robot.gimbal.pitch)
    yaw = _axis_constants(robot.firmware.yaw, robot.gimbal.yaw)
    # Of the shape of all gimbals: NumPy's loops over two axes would take most of the firmware's time.
    return Drive(**{name: np.tile([pitch[name], yaw[name]], (batch, 1)) for name in Drive._fields})


def _axis_constants(firmware: FirmwareAxis, motor: GimbalAxis) -> dict[str, float]:
    return {
        "angle_gain": firmware.angle_gain_per_s,
        "rate_limit": firmware.rate_limit_rad_per_s,
        "rate_gain": firmware.rate_gain_n_m_s_per_rad,
        "integral_gain": TICK_S * firmware.integral_gain_n_m_per_rad,
        "integral_limit": firmware.integral_limit_n_m,
        "torque_limit": motor.torque_limit_n_m,
        "command_low": math.radians(firmware.command_low_deg),
        "command_high": math.radians(firmware.command_high_deg),
        "quantum": 2.0 * math.pi / firmware.encoder_counts_per_turn,
        "angle_per_encoder": firmware.angle_per_encoder,
        "gyro_noise": firmware.gyro_noise_rad_per_s,
        "gyro_gain": -math.expm1(-2.0 * math.pi * firmware.gyro_cutoff_hz * TICK_S),
        "current_gain": 1.0 if motor.current_lag_ms == 0 else -math.expm1(-1e3 * TICK_S / motor.current_lag_ms),
        "stall_torque": motor.motor_constant_v_s_per_rad * motor.supply_v / motor.resistance_ohm,
        "back_emf": motor.motor_constant_v_s_per_rad**2 / motor.resistance_ohm,
    }


def encoder_angle(drive: Drive, angle: Array) -> Array:
    """Return what the encoders read at true angles [rad], shape (..., B, 2)."""
    return drive.quantum * np.rint(angle / (drive.angle_per_encoder * drive.quantum))


def filtered_rate(drive: Drive, gyro: Array, rate: Array, normals: Array) -> Array:
    """Return the filtered reading of the gyros [rad/s], shape (B, 2).

    Args:
      drive: constants.
      gyro: filtered reading of the tick before [rad/s], shape (B, 2).
      rate: true rates [rad/s], shape (B, 2).
      normals: standard normals, shape (B, 2).
    """
    return gyro + drive.gyro_gain * (rate + drive.gyro_noise * normals - gyro)


def firmware_torque(drive: Drive, integral: Array, command: Array, encoder: Array, gyro: Array) -> tuple[Array, Array]:
    """Return the torque of the integral after a tick, and the torque requested of the motors [N·m], shape (B, 2) each.

    Args:
      drive: constants.
      integral: torque of the integral before [N·m], shape (B, 2).
      command: between `command_low` and `command_high` [rad], shape (B, 2).
      encoder: reading [rad], shape (B, 2).
      gyro: filtered reading [rad/s], shape (B, 2).
    """
    error = _limited(drive.angle_gain * (command - encoder), drive.rate_limit) - gyro
    free = drive.rate_gain * error + integral
    torque = _limited(free, drive.torque_limit)
    # Conditional anti-windup: at the torque's limit the integral changes only away from it.
    changes = (free == torque) | (free * error < 0.0)
    integral = integral + np.where(changes, drive.integral_gain * error, 0.0)
    return _limited(integral, drive.integral_limit), torque


def motor_torque(drive: Drive, torque: Array, requested: Array, rate: Array) -> Array:
    """Return the torque over the next tick [N·m], shape (B, 2).

    Args:
      drive: constants.
      torque: over the tick before [N·m], shape (B, 2).
      requested: by the firmware [N·m], shape (B, 2).
      rate: of the joints [rad/s], shape (B, 2).
    """
    # The driver limits the current, so its limit comes before what the supply can push through the winding.
    torque = _limited(torque + drive.current_gain * (requested - torque), drive.torque_limit)
    lost = drive.back_emf * rate
    return np.minimum(np.maximum(torque, -drive.stall_torque - lost), drive.stall_torque - lost)


def _limited(value: Array, limit: Array) -> Array:
    # np.clip takes twice as long on arrays of this size.
    return np.minimum(np.maximum(value, -limit), limit)
