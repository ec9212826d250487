"""What a robot and the computer that aims for it send each other: NumPy's arrays, each message with its two times.

The leading axes are any batch B; N messages follow. A place that no message takes has NaN as its times. Virtual robot
and logs have these messages, as do wires and the runtime; the black box is to have them as well.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.float64]


class Feedback(NamedTuple):
    """Reports of the gimbal."""

    sampled_s: Numbers  # when its sensors were read, on the robot's clock [s], B + (N,)
    received_s: Numbers  # on the computer's clock [s], B + (N,)
    angle: Numbers  # pitch and yaw [rad], B + (N, 2)
    rate: Numbers  # of the two [rad/s], B + (N, 2)


class Detections(NamedTuple):
    """Frames of the camera, of which each shows up to S plates, without identity."""

    exposed_s: Numbers  # when the frame was exposed, on the camera's clock [s], B + (N,)
    received_s: Numbers  # on the computer's clock [s], B + (N,)
    found: NDArray[np.bool_]  # which slots hold a plate, B + (N, S)
    position: Numbers  # of its centre in the camera's frame: x forward, y left, z up [m], B + (N, S, 3)


class CommandSent(NamedTuple):
    """Commands of the computer, as the robot has them after the wire's rounding."""

    sent_s: Numbers  # on the computer's clock [s], B + (N,)
    received_s: Numbers  # on the robot's clock [s], B + (N,)
    angle: Numbers  # pitch and yaw [rad], B + (N, 2)
