"""What reaches the computer that aims, and what becomes of a shot; everything for B robots."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish2.messages import CommandSent, Detections, Feedback

Array = NDArray[np.float64]


class Received(NamedTuple):
    """All that reached the computer in some ticks, B + (N,) of each kind; N depends on robot and ticks only."""

    feedback: Feedback
    detections: Detections
    commands: CommandSent
    """That came into force, as the robot reports them; N is as large as needed."""


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
