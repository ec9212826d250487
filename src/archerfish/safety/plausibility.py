"""Whether the gimbal does what its identified plant says: feedback against the prediction from the commands sent.

It finds what no checksum, sequence number or age shows: an axis with the wrong sign or unit, axes exchanged, feedback
that is late or stuck, a motor that is off. The plant must be that of the robot as it is: benchmarks/plausibility.py has
the false alarms of a worn robot with the plant of a good one. In the fastest motions the torque of a motor is limited
and a linear plant is wrong. So the residual that is tolerated grows with the square of the distance of the command from
the predicted angle, and shrinks again in tenths of a second; an offset below that is found when the motion has ended.
"""

from typing import NamedTuple

import numpy as np

from archerfish.arrays import Array, lift, namespace, select
from archerfish.dynamics.linear_axis import GimbalModel, advance, gimbal_angle, gimbal_rate, rest_state
from archerfish.records.plant import PlantRecord
from archerfish.robot import Robot
from archerfish.safety.gate import MEASURABLE

THRESHOLD_RAD = 0.03
"""Largest residual at small motions [rad]: of a plant without a validation residual, and of the worst one."""
IN_A_ROW = 3
"""Decisions with a larger residual until the feedback is implausible."""
_LEAST_THRESHOLD_RAD = 0.01  # of the best plant: a coarse wire and a jitter of its latency make some mrad
_RESIDUALS = 10.0  # threshold over the validation residual, whose motions are of some degrees: targets ask for more
_TOLERATED = 5.0  # residual per square of the largest lead of late [1/rad]: 10 mrad at 45 mrad, as for 1 rad/s
_LEAD_KEPT = 0.95  # share of the largest lead that is left after a decision
_SETTLING = 10  # decisions after the start that are not judged: the gimbal may have been moving


class Prediction(NamedTuple):
    """The plant that follows the commands sent; `resting_prediction` begins it."""

    plant: Array  # state of both axes, B + (2, n)
    lead: Array  # largest distance of the command from the predicted angle, of late [rad], B + (2,)
    decisions: Array  # since it began, B
    above: Array  # decisions in a row with a residual that is too large, B


def thresholds(robot: Robot) -> Array:
    """Return the largest residual of pitch and yaw at small motions [rad], float32, shape (2,).

    Args:
      robot: whose plants have a validation residual, or `THRESHOLD_RAD` is taken.
    """
    return np.array([_threshold(robot.pitch), _threshold(robot.yaw)], np.float32)


def _threshold(plant: PlantRecord) -> float:
    residual = plant.validation_residual
    if residual is None:
        return THRESHOLD_RAD
    return min(max(_RESIDUALS * residual, _LEAST_THRESHOLD_RAD), THRESHOLD_RAD)


def resting_prediction(model: GimbalModel, angle: Array) -> Prediction:
    """Return the plant at rest.

    Args:
      model: identified, for the decision period.
      angle: of the gimbal [rad], shape B + (2,).
    """
    xp = namespace(angle)
    zero = xp.zeros_like(angle[..., 0])
    return Prediction(rest_state(model, angle), xp.zeros_like(angle), zero, zero)


def compare_with_prediction(
    model: GimbalModel, threshold: Array, past: Prediction, command: Array, is_sent: Array, angle: Array, age: Array
) -> tuple[Prediction, Array]:
    """Advance the prediction by a decision period, and judge the feedback.

    Args:
      model: identified, for the decision period.
      threshold: residual that is too large at small motions [rad], shape (2,) or (); see `thresholds`.
      past: of the last decision.
      command: that has been in force since then [rad], shape B + (2,).
      is_sent: whether it was sent, a period ago; where it was not, the prediction begins again at the angle, shape B.
      angle: of the gimbal, measured [rad], shape B + (2,).
      age: of that measurement [s], shape B.

    Returns:
      The prediction, and whether the feedback is plausible, bool, shape B.
    """
    xp = namespace(command, angle)
    is_valid = xp.all(xp.abs(angle) <= MEASURABLE, axis=-1)
    place = select(is_valid, angle, command)
    plant = advance(model, past.plant, command)
    predicted = gimbal_angle(model, plant)
    expected = predicted - age[..., None] * gimbal_rate(model, plant)
    lead = xp.maximum(_LEAD_KEPT * past.lead, xp.abs(command - predicted))
    is_large = xp.any(xp.abs(angle - expected) > lift(threshold, lead) + _TOLERATED * lead * lead, axis=-1)
    above = xp.where(is_large & (past.decisions >= _SETTLING), past.above + 1.0, xp.zeros_like(past.above))
    going_on = Prediction(plant, lead, past.decisions + 1.0, above)
    following = select(is_sent, going_on, resting_prediction(model, place))
    return following, ~(following.above >= IN_A_ROW)
