"""Where a command would come to rest: on which side of the aim decides between pushing on and braking."""

from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.dynamics.command_limits import fastest_approach


def overshoot(braking: Array, aim: Array, command: Array, before: Array) -> Array:
    """From where the command would come to rest, braking from its last move d on, to the aim: d |d| / (2 b) of way.

    The switching rule of a time-optimal slew.

    Args:
      braking: by how much the command's move per decision may change, b [rad], shape (2,).
      aim: where to go [rad], shape B + (2,).
      command: in force now [rad], shape B + (2,).
      before: in force a decision earlier [rad], shape B + (2,).
    """
    move = command - before
    way = move * namespace(move).abs(move) / (2.0 * lift(braking, move))
    return aim - command - way


def on_the_way(braking: Array, wanted: Array, command: Array) -> Array:
    """Return the next command on the fastest way to a wanted one that can stop there.

    Args:
      braking: by how much the command's move per decision may change [rad], shape (2,).
      wanted: where to go [rad], shape B + (2,).
      command: in force now [rad], shape B + (2,).
    """
    xp = namespace(wanted, command)
    way = wanted - command
    move = fastest_approach(xp.abs(way), lift(braking, way), 1.0)
    return xp.where(xp.abs(way) <= move * (1.0 + 1e-5), wanted, command + xp.sign(way) * move)
