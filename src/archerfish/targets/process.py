"""A random process with habits: a target's past says something about its future, but never everything.

A target drives or stands, leg by leg. It has a usual dwell and a usual speed, and for each a share by which its legs
depart from it: with 0 all are alike, with 1 they have nothing in common. How often it stands, and how often it drives
on to the side of the leg before, are its own, too. Some drive along a line, some turn at each leg, some turn steadily;
some drive on for long once they have set off.
"""

from archerfish.arrays import Array, namespace
from archerfish.targets.distributions import DWELL, HABITS, LEG_SPEED, draw_parameters
from archerfish.targets.kinds import driven

LEGS = 28
"""Legs that are drawn; in the last a target continues as it moves."""
PROCESS_UNIFORMS = 12 + 4 * LEGS
"""Uniform draws of a target: its own, then those of its legs."""
DRIVES_ON, LONG_S = 0.25, 2.5
"""Share of the targets whose legs are long, once they drive, and how long [s]. Without them a policy takes every target
that sets off for one that stops or turns within half a second, and loses up to 6 points to `imm-lq` where it does not.
"""


def random_process(uniforms: Array, duration: Array) -> Array:  # noqa: ARG001 (as every kind's)
    """Return displacements from the target's place, zero at time zero, at `motion.TIMES` [m], shape B + (N, 2).

    Args:
      uniforms: uniform draws, shape B + (PROCESS_UNIFORMS,) or more.
      duration: of the engagement, without effect [s], shape B.
    """
    xp = namespace(uniforms)
    acceleration, heading, rate = draw_parameters(HABITS, uniforms[..., None, :])
    left, dwell, dwell_varies, speed, speed_varies, rest, keeps, form = (uniforms[..., at, None] for at in range(3, 11))
    own_dwell, own_speed, choice, turn = (uniforms[..., 12 + at * LEGS : 12 + (at + 1) * LEGS] for at in range(4))
    dwell = DWELL.draw(dwell + dwell_varies * (own_dwell - dwell))
    speed = LEG_SPEED.draw(speed + speed_varies * (own_speed - speed))
    rest = 0.9 * rest**1.57  # share of standing legs: 0.35 in the mean
    dwell = xp.where((uniforms[..., 11, None] < DRIVES_ON) & (choice >= rest), LONG_S + 0.0 * dwell, dwell)
    # One draw is whether a leg stands and, of a leg that drives, whether it keeps the side of the one before.
    changes = xp.cumulative_sum(xp.astype(choice - rest >= keeps * (1.0 - rest), xp.int32), axis=-1)
    velocity = xp.where(choice < rest, 0.0 * speed, xp.where(changes % 2 == 0, speed, -speed))
    # 60 % of the targets drive along one line, 20 % turn by up to 0.6 rad at each leg, 20 % steadily.
    bend = 0.6 * xp.cumulative_sum(2.0 * turn - 1.0, axis=-1)
    turned = xp.where(form < 0.8, bend, rate * (xp.cumulative_sum(dwell, axis=-1) - 0.5 * dwell))
    heading = heading + xp.where(form < 0.6, 0.0 * bend, turned)
    velocity = xp.stack([velocity * xp.sin(heading), velocity * xp.cos(heading)], axis=-2)
    return xp.moveaxis(driven(velocity, dwell[..., :-1], left, acceleration), -1, -2)
