"""Whether the gimbal does what its identified plant says: feedback against the prediction from the commands sent.

It finds what no checksum, sequence number or age shows: an axis with the wrong sign or unit, axes exchanged, feedback
that is late or stuck, a motor that is off. The plant must be that of the robot: with the plant of a good robot, a worn
one has residuals of up to 0.13 rad for three decisions (benchmarks/plausibility.py).
"""

from typing import NamedTuple

from archerfish.arrays import Array, namespace, select
from archerfish.dynamics.linear_axis import GimbalModel, advance, gimbal_angle, gimbal_rate, rest_state
from archerfish.safety.gate import MEASURABLE

THRESHOLD_RAD = 0.03
"""Residual of a plant with no validation residual of its own [rad]."""
_IN_A_ROW = 3  # decisions above the threshold
_SETTLING = 10  # decisions after the start that are not judged: the gimbal may have been moving


class Prediction(NamedTuple):
    """The plant that follows the commands sent; `resting_prediction` begins it."""

    plant: Array  # state of both axes, B + (2, n)
    decisions: Array  # since it began, B
    above: Array  # decisions in a row with a residual above the threshold, B


def resting_prediction(model: GimbalModel, angle: Array) -> Prediction:
    """Return the plant at rest.

    Args:
      model: identified, for the decision period.
      angle: of the gimbal [rad], shape B + (2,).
    """
    zero = namespace(angle).zeros_like(angle[..., 0])
    return Prediction(rest_state(model, angle), zero, zero)


def compare_with_prediction(
    model: GimbalModel, threshold: Array, past: Prediction, command: Array, is_sent: Array, angle: Array, age: Array
) -> tuple[Prediction, Array]:
    """Advance the prediction by a decision period, and judge the feedback.

    Args:
      model: identified, for the decision period.
      threshold: residual that is too large [rad], shape (2,) or ().
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
    expected = gimbal_angle(model, plant) - age[..., None] * gimbal_rate(model, plant)
    is_large = xp.any(xp.abs(angle - expected) > threshold, axis=-1)
    above = xp.where(is_large & (past.decisions >= _SETTLING), past.above + 1.0, xp.zeros_like(past.above))
    going_on = Prediction(plant, past.decisions + 1.0, above)
    following = select(is_sent, going_on, resting_prediction(model, place))
    return following, ~(following.above >= _IN_A_ROW)
