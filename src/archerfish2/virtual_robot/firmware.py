"""The gimbal's firmware: angle P → rate PI → torque at 1 kHz, on a quantised encoder and a noisy gyro.

Pure functions on arrays of a batch: the state goes in, the next one comes out.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish2.virtual_robot.description import TICK_S, Firmware, Gimbal

Array = NDArray[np.float64]


class Gains(NamedTuple):
    """What the firmware of both axes, pitch and yaw, is set to."""

    angle: Array
    """Asked rate per angle error [1/s], shape (2,)."""
    rate_limit: Array
    """Largest asked rate [rad/s], shape (2,)."""
    rate: Array
    """Torque per rate error [N·m·s/rad], shape (2,)."""
    integral: Array
    """Torque per integrated rate error, over a tick [N·m·s/rad], shape (2,)."""
    integral_limit: Array
    """Largest torque of the integral [N·m], shape (2,)."""
    torque_limit: Array
    """Largest torque [N·m], shape (2,)."""
    command_low: Array
    """Smallest command [rad], shape (2,)."""
    command_high: Array
    """Largest command [rad], shape (2,)."""
    quantum: Array
    """Step of the encoder [rad], shape (2,)."""
    angle_per_encoder: Array
    """True angle over the encoder's, shape (2,)."""
    gyro_noise: Array
    """Standard deviation of the gyro [rad/s], shape (2,)."""
    gyro_gain: Array
    """Share of the way to a new reading that the gyro's filter covers in a tick, shape (2,)."""


class FirmwareState(NamedTuple):
    """What the firmware remembers."""

    integral: Array
    """Torque of the integral [N·m], shape (B, 2)."""
    gyro: Array
    """Filtered rate [rad/s], shape (B, 2)."""


def make_gains(firmware: Firmware, gimbal: Gimbal) -> Gains:
    """Build the settings of a robot's firmware."""
    axes, motors = (firmware.pitch, firmware.yaw), (gimbal.pitch, gimbal.yaw)
    return Gains(
        angle=np.array([axis.angle_gain_per_s for axis in axes]),
        rate_limit=np.array([axis.rate_limit_rad_per_s for axis in axes]),
        rate=np.array([axis.rate_gain_n_m_s_per_rad for axis in axes]),
        integral=TICK_S * np.array([axis.integral_gain_n_m_per_rad for axis in axes]),
        integral_limit=np.array([axis.integral_limit_n_m for axis in axes]),
        torque_limit=np.array([motor.torque_limit_n_m for motor in motors]),
        command_low=np.radians([axis.command_low_deg for axis in axes]),
        command_high=np.radians([axis.command_high_deg for axis in axes]),
        quantum=np.array([2.0 * math.pi / axis.encoder_counts_per_turn for axis in axes]),
        angle_per_encoder=np.array([axis.angle_per_encoder for axis in axes]),
        gyro_noise=np.array([axis.gyro_noise_rad_per_s for axis in axes]),
        gyro_gain=np.array([-math.expm1(-2.0 * math.pi * axis.gyro_cutoff_hz * TICK_S) for axis in axes]),
    )


def encoder_angle(gains: Gains, angle: Array) -> Array:
    """Return what the encoders read at true angles [rad], shape (..., 2)."""
    return gains.quantum * np.rint(angle / (gains.angle_per_encoder * gains.quantum))


def filtered_rate(gains: Gains, gyro: Array, rate: Array, normals: Array) -> Array:
    """Return the gyro's filtered reading [rad/s], shape (B, 2).

    Args:
      gains: settings.
      gyro: the reading before [rad/s], shape (B, 2).
      rate: true rates [rad/s], shape (B, 2).
      normals: standard normals, shape (B, 2).
    """
    return gyro + gains.gyro_gain * (rate + gains.gyro_noise * normals - gyro)


def firmware_torque(
    gains: Gains, state: FirmwareState, command: Array, encoder: Array, gyro: Array
) -> tuple[FirmwareState, Array]:
    """Compute a tick's torque.

    Args:
      gains: settings.
      state: of the firmware.
      command: within the firmware's range [rad], shape (B, 2).
      encoder: reading [rad], shape (B, 2).
      gyro: filtered reading [rad/s], shape (B, 2).

    Returns:
      The state, and the torque asked of the motors [N·m], shape (B, 2).
    """
    asked = gains.angle * (command - encoder)
    asked = np.minimum(np.maximum(asked, -gains.rate_limit), gains.rate_limit)
    error = asked - gyro
    free = gains.rate * error + state.integral
    torque = np.minimum(np.maximum(free, -gains.torque_limit), gains.torque_limit)
    # Conditional anti-windup: at the limit the integral takes only what leads away from it.
    grows = (free == torque) | (free * error < 0.0)
    integral = state.integral + np.where(grows, gains.integral * error, 0.0)
    integral = np.minimum(np.maximum(integral, -gains.integral_limit), gains.integral_limit)
    return FirmwareState(integral, gyro), torque
