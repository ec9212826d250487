"""A random process with habits: a target's past says something about its future, but never everything.

A target drives or stands, leg by leg. It has a usual dwell and a usual speed, and for each a share by which its legs
depart from it: with 0 all are alike, with 1 they have nothing in common. How often it stands, and how often it drives
on to the side of the leg before, are its own, too; some drive on for long once they have set off.

Most targets move along two axes at right angles, each with legs and habits of its own, so one may be steady while the
other is restless. The axes point forward and sideways, turned by up to 45°. With turned axes a reversal along one of
them also changes the speed across the line of sight, and reverses it in about a quarter of the cases. The other targets
have legs along one line; some of them turn at each leg, some steadily.
"""

from archerfish.arrays import Array, namespace
from archerfish.targets.distributions import AXIS_SPEED, DWELL, HABITS, LINE_SPEED, draw_parameters
from archerfish.targets.kinds import driven

LEGS = 28
"""Legs along an axis that are drawn; in the last a target continues as it moves."""
_HABITS = 8
AXIS_UNIFORMS = _HABITS + 3 * LEGS
"""Uniform draws of an axis: its habits, then dwell, speed and choice of its legs."""
_OWN = 5
PROCESS_UNIFORMS = _OWN + 2 * AXIS_UNIFORMS + LEGS
"""Uniform draws of a target: its own, those of two axes, then a turn at each leg."""
TWO_AXES = 0.6
"""Share of the targets that move along two axes. Without them a policy shortens its lead sideways whenever a target
reverses in depth."""
LONG_S = 2.5
"""Duration of long legs [s]."""
DRIVES_ON = 0.25
"""Share of the targets with legs along one line whose driving legs are long. Without them a policy takes every target
that sets off for one that stops or turns within half a second, and loses up to 6 points to `imm-lq` where it does not.
"""
STEADY = 0.5
"""Share of the axes of targets with two whose driving legs are long."""


def random_process(uniforms: Array, duration: Array) -> Array:  # noqa: ARG001 (as every kind's)
    """Return displacements from the target's place, zero at time zero, at `motion.TIMES` [m], shape B + (N, 2).

    Args:
      uniforms: uniform draws, shape B + (PROCESS_UNIFORMS,) or more.
      duration: of the engagement, without effect [s], shape B.
    """
    xp = namespace(uniforms)
    acceleration, heading, rate = draw_parameters(HABITS, uniforms[..., None, :])
    form, axes = uniforms[..., 3, None], uniforms[..., 4, None]
    two = axes < TWO_AXES
    first, second = (uniforms[..., _OWN + at * AXIS_UNIFORMS :][..., :AXIS_UNIFORMS] for at in range(2))
    lateral_speed, dwell, left = _legs(first, two)
    forward_speed, forward_dwell, forward_left = _legs(second, two)
    # Of those with legs along one line, 60 % keep it, 20 % turn by up to 0.6 rad at each leg, 20 % steadily.
    turn = uniforms[..., _OWN + 2 * AXIS_UNIFORMS :][..., :LEGS]
    bend = 0.6 * xp.cumulative_sum(2.0 * turn - 1.0, axis=-1)
    turned = xp.where(form < 0.8, bend, rate * (xp.cumulative_sum(dwell, axis=-1) - 0.5 * dwell))
    course = heading + xp.where(form < 0.6, 0.0 * bend, turned)
    one_line = xp.stack([lateral_speed * xp.sin(course), lateral_speed * xp.cos(course)], axis=-2)
    velocity = xp.where(two[..., None], xp.stack([forward_speed, lateral_speed], axis=-2), one_line)
    # Along one line a change of velocity takes as long in both directions.
    change = xp.abs(velocity[..., 1:] - velocity[..., :-1])
    together = xp.sqrt(xp.sum(change**2, axis=-2, keepdims=True))
    ramp = xp.where(two[..., None], change, together) / acceleration[..., None]
    lengths = xp.stack([xp.where(two, forward_dwell, dwell), dwell], axis=-2)[..., :-1]
    moved = driven(velocity, lengths, xp.stack([xp.where(two, forward_left, left), left], axis=-2), ramp)
    forward, lateral = moved[..., 0, :], moved[..., 1, :]
    angle = xp.where(two, 0.25 * heading, 0.0 * heading)
    cosine, sine = xp.cos(angle), xp.sin(angle)
    return xp.stack([cosine * forward + sine * lateral, cosine * lateral - sine * forward], axis=-1)


def _legs(uniforms: Array, two: Array) -> tuple[Array, Array, Array]:
    """Return speed [m/s], negative backwards, and dwell [s] of the legs along an axis, and what is left of the first.

    Args:
      uniforms: uniform draws, shape B + (AXIS_UNIFORMS,).
      two: whether the target moves along two axes, shape B + (1,).

    Returns:
      Shapes B + (LEGS,) twice, and B + (1,): the share of the first leg that is left when the path begins.
    """
    xp = namespace(uniforms)
    habits = (uniforms[..., at, None] for at in range(_HABITS))
    left, dwell, dwell_varies, speed, speed_varies, rest, keeps, long = habits
    own_dwell, own_speed, choice = (uniforms[..., _HABITS + at * LEGS :][..., :LEGS] for at in range(3))
    dwell = DWELL.draw(dwell + dwell_varies * (own_dwell - dwell))
    drawn = speed + speed_varies * (own_speed - speed)
    speed = xp.where(two, AXIS_SPEED.draw(drawn), LINE_SPEED.draw(drawn))
    rest = 0.9 * rest**1.57  # share of standing legs: 0.35 in the mean
    drives_on = long < xp.where(two, STEADY, DRIVES_ON)
    dwell = xp.where(drives_on & (choice >= rest), LONG_S + 0.0 * dwell, dwell)
    # One draw is whether a leg stands and, of a leg that drives, whether it keeps the side of the one before.
    changes = xp.cumulative_sum(xp.astype(choice - rest >= keeps * (1.0 - rest), xp.int32), axis=-1)
    speed = xp.where(choice < rest, 0.0 * speed, xp.where(changes % 2 == 0, speed, -speed))
    return speed, dwell, left
