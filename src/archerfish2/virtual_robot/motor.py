"""The motors: current loop with lag, torque limit, and the voltage that is left beyond the back EMF."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish2.virtual_robot.description import TICK_S, Gimbal

Array = NDArray[np.float64]


class Motor(NamedTuple):
    """Two motors, pitch and yaw."""

    limit: Array
    """Largest torque [N·m], shape (2,)."""
    gain: Array
    """Share of the way to the asked torque that a tick covers, shape (2,)."""
    stall: Array
    """Torque at rest under the full voltage [N·m], shape (2,)."""
    slope: Array
    """Torque that a unit of speed takes from it [N·m·s/rad], shape (2,)."""


def make_motor(gimbal: Gimbal) -> Motor:
    """Build the motors of a gimbal."""
    axes = (gimbal.pitch, gimbal.yaw)
    stall = [axis.motor_constant_v_s_per_rad * axis.supply_v / axis.resistance_ohm for axis in axes]
    slope = [axis.motor_constant_v_s_per_rad**2 / axis.resistance_ohm for axis in axes]
    gain = [1.0 if axis.current_lag_ms == 0 else -math.expm1(-1e3 * TICK_S / axis.current_lag_ms) for axis in axes]
    return Motor(np.array([axis.torque_limit_n_m for axis in axes]), *map(np.array, (gain, stall, slope)))


def motor_torque(motor: Motor, torque: Array, asked: Array, rate: Array) -> Array:
    """Return the torque over the next tick.

    Args:
      motor: the motors.
      torque: over the tick before [N·m], shape (B, 2).
      asked: by the firmware [N·m], shape (B, 2).
      rate: of the joints [rad/s], shape (B, 2).
    """
    torque = torque + motor.gain * (asked - torque)
    # The driver's limit is one of current, so it comes before what the supply can push through the winding.
    torque = np.minimum(np.maximum(torque, -motor.limit), motor.limit)
    lost = motor.slope * rate
    return np.minimum(np.maximum(torque, -motor.stall - lost), motor.stall - lost)
