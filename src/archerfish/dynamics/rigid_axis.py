"""A gimbal axis as a rigid body, eq (1).

Pitch, eq (2), is a damped pendulum under torque; yaw, eq (3), is a damped wheel.
"""

from typing import NamedTuple

from archerfish.arrays import Array, namespace
from archerfish.dynamics.pellet import runge_kutta_4


class RigidAxis(NamedTuple):
    """Parameters of one axis; each may have a batch shape."""

    mass: Array  # m [kg], B
    length: Array  # l of the swing arm [m], B
    damping: Array  # b [N m s/rad], B
    gravity: Array  # g along the plane of the swing [m/s²], B; zero for yaw


class RigidState(NamedTuple):
    """Where an axis is and how fast it turns."""

    angle: Array  # from the arm hanging down for pitch, from any direction for yaw [rad], B
    rate: Array  # [rad/s], B


def rigid_derivative(axis: RigidAxis, state: RigidState, torque: Array) -> RigidState:
    """Return the time derivative of the state, eq (2) and eq (3) corrected.

    θ̈ = −(g/l) sin θ − b θ̇/(m l²) + T/(m l²), as eq (1) demands. Eq (2) and eq (3) print the damping term without θ̇
    and the torque without 1/(m l²) (docs/paper.md).

    Args:
      axis: parameters, shape B.
      state: angle and rate, shape B.
      torque: T [N m], shape B.

    Returns:
      Rate [rad/s] and acceleration [rad/s²], shape B.
    """
    inertia = axis.mass * axis.length**2
    weight = axis.gravity / axis.length * namespace(state.angle).sin(state.angle)
    return RigidState(state.rate, (torque - axis.damping * state.rate) / inertia - weight)


def dry_friction(axis: RigidAxis, state: RigidState, torque: Array, friction: Array, period: Array) -> Array:
    """Return the torque of Coulomb friction over a step, which eq (1) leaves out.

    It opposes the motion with its full size while the axis slides, and with no more than stops the axis within the
    step, so that an axis at rest stays there under any torque that is smaller (friction implicit in the rate).

    Args:
      axis: parameters, shape B.
      state: angle and rate, shape B.
      torque: T [N m], shape B.
      friction: largest moment of friction ≥ 0 [N m], shape B.
      period: step [s].

    Returns:
      Torque to be added to T [N m], shape B.
    """
    xp = namespace(state.angle, state.rate, torque)
    pushed = rigid_derivative(axis, state, torque).rate + state.rate / period
    stopping = -axis.mass * axis.length**2 * pushed
    return xp.minimum(xp.maximum(stopping, -friction), friction)


def rigid_step(axis: RigidAxis, state: RigidState, torque: Array, period: Array) -> RigidState:
    """Advance an axis by one classical Runge–Kutta step under a held torque.

    Args:
      axis: parameters, shape B.
      state: angle and rate, shape B.
      torque: T [N m], held, shape B.
      period: step [s], well below the time constant m l²/b and the period of the swing.
    """
    xp = namespace(state.angle, state.rate, torque)

    def slope(stacked: Array) -> Array:
        return xp.stack(rigid_derivative(axis, RigidState(stacked[0], stacked[1]), torque))

    angle, rate = runge_kutta_4(slope, xp.stack(xp.broadcast_arrays(*state)), period)
    return RigidState(angle, rate)
