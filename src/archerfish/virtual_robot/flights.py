"""What reaches the computer that aims, and what becomes of a shot, for B robots."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.messages import CommandSent, Detections, Feedback

Array = NDArray[np.float64]


class Received(NamedTuple):
    """All that reached the computer in some ticks; N of each kind, which depends on robot and ticks alone."""

    feedback: Feedback  # B + (N,)
    detections: Detections  # B + (N,)
    commands: CommandSent  # that came into force, as the robot reports them; N is as large as needed


class Flight(NamedTuple):
    """What became of a shot at the target; NaN for a robot that did not fire."""

    miss: Array  # pellet minus plate in y and z where the pellet crosses the plate's x [m], NaN if never, (B, 2)
    flight_time: Array  # [s], NaN if it never crosses, (B,)
    angle: Array  # true pitch and yaw at firing [rad], (B, 2)
    muzzle_speed_measured: Array  # by the speed sensor [m/s], (B,)
    fired: NDArray[np.bool_]  # whether a pellet left the muzzle, (B,)


class Landing(NamedTuple):
    """Where pellets met the ground; NaN for a robot that did not fire."""

    distance: Array  # along the ground from below the muzzle [m], (B,)
    lateral: Array  # to the left of the barrel's vertical plane [m], (B,)
    muzzle_speed_measured: Array  # by the speed sensor [m/s], (B,)


class TrueState(NamedTuple):
    """The true mechanics, for tests and plots, never for controllers."""

    angle: Array  # pitch and yaw [rad], (B, 2)
    rate: Array  # [rad/s], (B, 2)
    command: Array  # in force [rad], (B, 2)
    torque: Array  # of the motors over the last tick [N·m], (B, 2)
