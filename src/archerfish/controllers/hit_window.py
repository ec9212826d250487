"""The place to aim at where a target may be in one of several places: where the chance of a hit is largest.

The mean of the places may be one where the target never is, as half way between a target that has turned back and one
that has not.
"""

from archerfish.dynamics.array_namespace import Array, lift, namespace

PLACES = 17
"""Aims that are tried, from left of all places to right of them."""
_SHARPNESS = 200.0
"""Aims whose chances differ by much less than one over this are as good as each other: their mean is taken."""
_WIDTH = 4.25
"""Width of a parabolic density whose distribution function is nearest to the normal one, in standard deviations."""


def most_hits(place: Array, sd: Array, reach: Array, chance: Array | None = None) -> Array:
    """Return the aim whose pellet most likely hits, on a line across the line of sight.

    Where two places far apart are as likely as each other to within a percent or so, that is a place between them; to
    decide for either of them hits no more (measured with `imm-lq` and `parabola-lq`, over 1,600 engagements).

    Args:
      place: where the target may be [m], shape B + (H,).
      sd: standard deviation of target and pellet about it [m], shape B + (H,).
      reach: hit radius [m], shape ().
      chance: of each place, shape B + (H,); all the same if not given.

    Returns:
      Shape B [m].
    """
    xp = namespace(place)
    # Beyond the outermost places too: of aims as good as each other the middle one is the safest.
    low, high = xp.min(place, axis=-1, keepdims=True) - reach, xp.max(place, axis=-1, keepdims=True) + reach
    tried = low + (high - low) * lift(xp.linspace(0.0, 1.0, PLACES, dtype=place.dtype), low)
    off, scale = tried[..., :, None] - place[..., None, :], 1.0 / sd[..., None, :]
    within = distribution((off + reach) * scale) - distribution((off - reach) * scale)
    score = xp.mean(within, axis=-1) if chance is None else xp.sum(chance[..., None, :] * within, axis=-1)
    sharp = xp.exp(_SHARPNESS * (score - xp.max(score, axis=-1, keepdims=True)))
    return xp.sum(sharp * tried, axis=-1) / xp.sum(sharp, axis=-1)


def distribution(deviate: Array) -> Array:
    """Return the distribution function of a parabolic density: within 0.023 of the normal one, and far cheaper.

    Args:
      deviate: in standard deviations, shape B.
    """
    share = namespace(deviate).clip(0.5 + deviate * (1.0 / _WIDTH), 0.0, 1.0)
    return share**2 * (3.0 - 2.0 * share)


def across_sight(place: Array) -> tuple[Array, Array]:
    """Return the level direction to the left of the line of sight, shape B + (2,), and the distance [m], shape B.

    Args:
      place: x and y [m], shape B + (2,).
    """
    xp = namespace(place)
    distance = xp.sqrt(xp.sum(place**2, axis=-1))
    return xp.stack([-place[..., 1], place[..., 0]], axis=-1) / distance[..., None], distance
