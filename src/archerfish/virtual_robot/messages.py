"""What reaches the host program, and what a shot gives; everything batched over B trials."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Heard(NamedTuple):
    """All that reached the host in some ticks; NaN or False fills places that no message takes.

    Times are in seconds on the robot's clock unless said otherwise. F and G depend on the robot and on the number of
    ticks only.
    """

    feedback_received: Array
    """When each report of the gimbal was received, shape (B, F)."""
    feedback_stamp: Array
    """When the robot read its sensors for it, shape (B, F)."""
    feedback_angle: Array
    """Pitch and yaw [rad], shape (B, F, 2)."""
    feedback_rate: Array
    """Their rates [rad/s], shape (B, F, 2)."""
    frame_received: Array
    """When each camera frame's detection was received, shape (B, G)."""
    frame_stamp: Array
    """Its stamp on the camera's clock, shape (B, G)."""
    frame_found: NDArray[np.bool_]
    """Whether the plate was found in it, shape (B, G)."""
    frame_position: Array
    """The plate in the camera's frame, x forward, y left, z up [m], shape (B, G, 3)."""
    command_stamp: Array
    """When the robot received each command that came into force, shape (B, H); H is as large as needed."""
    command_sent: Array
    """When the host had sent each of them, as the command itself says, shape (B, H)."""
    command_value: Array
    """That command as the robot has it, after the wire's rounding and the firmware's range [rad], shape (B, H, 2)."""


class Flight(NamedTuple):
    """What became of a shot; NaN for a robot that did not fire."""

    miss: Array
    """Pellet minus plate in y and z where the pellet crosses the plate's x [m], NaN if it never does, shape (B, 2)."""
    flight_time: Array
    """[s], shape (B,)."""
    angle: Array
    """True pitch and yaw at firing [rad], shape (B, 2)."""
    muzzle_speed_measured: Array
    """What the speed sensor shows [m/s], shape (B,)."""
    fired: NDArray[np.bool_]
    """Whether a pellet left the muzzle, shape (B,)."""


class Landing(NamedTuple):
    """Where pellets met the ground; NaN for a robot that did not fire."""

    distance: Array
    """Along the ground from below the muzzle to the landing point [m], shape (B,)."""
    lateral: Array
    """How far left of the barrel's vertical plane it lies [m], shape (B,)."""
    angle: Array
    """True pitch and yaw at firing [rad], shape (B, 2)."""
    muzzle_speed_measured: Array
    """What the speed sensor shows [m/s], shape (B,)."""
    fired: NDArray[np.bool_]
    """Whether a pellet left the muzzle, shape (B,)."""


class Truth(NamedTuple):
    """How it really is; for tests and plots, never for controllers."""

    angle: Array
    """Pitch and yaw [rad], shape (B, 2)."""
    rate: Array
    """[rad/s], shape (B, 2)."""
    command: Array
    """Command in force [rad], shape (B, 2)."""
    torque: Array
    """Of the motors over the last tick [N·m], shape (B, 2)."""
