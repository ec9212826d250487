"""A reward and an observation block of your own."""

from archerfish.authors import namespace


def centred(shot, command, seen):
    """Reward a pellet by how near to the plate's centre it passes, farther than 20 cm all alike [m], shape B."""
    return namespace(shot.margin).clip(shot.margin, -0.14, 0.06)


def yaw_move(observer, view):
    """Return the last move of the yaw command [rad], shape B + (1,)."""
    yaw = view.memory.decisions.command[..., 1]
    return yaw[..., -1:] - yaw[..., -2:-1]
