"""Where a command would come to rest: on which side of the aim decides between pushing on and braking."""

from archerfish.dynamics.array_namespace import Array, lift, namespace


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
