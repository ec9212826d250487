"""Where to aim if a target may be in one of several places: at the place where a hit is likeliest.

The mean of the places would not do. The target may never be there: half way between a target that has turned back and
one that has not there is nothing to hit.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from archerfish.arrays import Array, lift, namespace
from archerfish.controllers.predictors.predictor import Predictor
from archerfish.tracking.detections import relative_place
from archerfish.tracking.parabola_filter import distribution

PLACES = 17
"""Aims that are tried, from left of all places to right of them."""
_SHARPNESS = 200.0
"""Aims whose probabilities of a hit differ by much less than the inverse of this count alike: their mean is taken."""


class Places(NamedTuple):
    """Where a target may be at some time: H places."""

    level: Array  # x and y in O [m], B + (H, 2)
    height: Array  # the same of all, in O [m], B + (1,)
    variance: Callable[[Array], Array]  # level unit vector, B + (2,) → variance of the places along it [m²], B + (H,)
    #                                     or B + (1,)
    probability: Array | None = None  # of each, B + (H,); None: all the same


def mean_place(places: Places) -> Array:
    """Return the mean of the places in O [m], shape B + (3,)."""
    xp = namespace(places.level)
    level, p = places.level, places.probability
    level = xp.mean(level, axis=-2) if p is None else xp.sum(p[..., None] * level, axis=-2)
    return xp.concat([level, places.height + 0.0 * level[..., :1]], axis=-1)


class LikeliestHit(Predictor, Protocol):
    """A predictor of several places where the target may be; its prediction is where a pellet hits most likely.

    The prediction is searched for on one level line: through the mean of the places, across the line of sight.
    """

    reach: Array  # hit radius [m], ()
    scatter: Array  # standard deviation of the pellets' azimuth [rad], ()

    def places(self, state: Any, time: Array) -> Places:
        """Return where the target may be a time [s] from now, shape B."""

    def predicted(self, state: Any, age: Array) -> Array:
        """Return the mean of the places where the target may have been, in O [m], shape B → B + (3,)."""
        return mean_place(self.places(state, -age))

    def mean_after(self, relative: Any, time: Array) -> Array:
        """Return the mean of all places where the target may be, relative to the own pivot [m], shape B + (3,)."""
        return relative_place(mean_place(self.places(relative[0], time)), relative[1], time)

    def position_after(self, relative: Any, time: Array) -> Array:
        """Return the place that a pellet most likely hits, relative to the own pivot [m], shape B + (3,)."""
        places = self.places(relative[0], time)
        xp, mean = namespace(places.level), mean_place(places)
        center = relative_place(mean, relative[1], time)
        level = center[..., :2]
        distance = xp.sqrt(xp.sum(level**2, axis=-1))
        left = xp.stack([-level[..., 1], level[..., 0]], axis=-1) / distance[..., None]
        lateral = xp.sum((places.level - mean[..., None, :2]) * left[..., None, :], axis=-1)
        sd = xp.sqrt(places.variance(left) + ((self.scatter * distance) ** 2)[..., None])
        aim = most_hits(lateral, sd, self.reach, places.probability)
        return xp.concat([level + aim[..., None] * left, center[..., 2:]], axis=-1)


def most_hits(place: Array, sd: Array, reach: Array, probability: Array | None = None) -> Array:
    """Return the aim whose pellet most likely hits, on a line.

    Where two places far apart are as likely as each other to within a percent or so, that is a place between them; to
    decide for either of them hits no more (measured with `imm-lq` and `parabola-lq`, over 1,600 engagements).

    Args:
      place: where the target may be [m], shape B + (H,).
      sd: standard deviation of target and pellet about it [m], shape B + (H,) or B + (1,).
      reach: hit radius [m], shape ().
      probability: of each place, shape B + (H,); all the same if not given.

    Returns:
      Shape B [m].
    """
    xp = namespace(place)
    # Beyond the outermost places too: of aims as good as each other the middle one is the safest.
    low, high = xp.min(place, axis=-1, keepdims=True) - reach, xp.max(place, axis=-1, keepdims=True) + reach
    tried = low + (high - low) * lift(xp.linspace(0.0, 1.0, PLACES, dtype=place.dtype), low)
    off, scale = tried[..., :, None] - place[..., None, :], 1.0 / sd[..., None, :]
    within = distribution((off + reach) * scale) - distribution((off - reach) * scale)
    score = xp.mean(within, axis=-1) if probability is None else xp.sum(probability[..., None, :] * within, axis=-1)
    sharp = xp.exp(_SHARPNESS * (score - xp.max(score, axis=-1, keepdims=True)))
    return xp.sum(sharp * tried, axis=-1) / xp.sum(sharp, axis=-1)
