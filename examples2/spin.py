"""A reward and an observation block of your own."""

from archerfish2.arrays import namespace


def centred(shot, command, seen):
    """Reward a pellet by how near to the plate's centre it passes, up to 20 cm, and early commands by nothing else.

    Args:
      shot: what became of the decision; `shot.margin` is from the edge of the hit area inwards [m].
      command: the policy's, before the limits.
      seen: what is seen after the shot.
    """
    xp = namespace(shot.margin)
    return xp.clip(shot.margin, -0.14, 0.06)


def yaw_rate(observer, view):
    """Return the command's last yaw rate in rad/s, shape B + (1,)."""
    yaw = view.memory.decisions.command[..., 1]
    return (yaw[..., -1:] - yaw[..., -2:-1]) / 0.02
