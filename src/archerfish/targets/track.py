"""A recorded path."""

from typing import NamedTuple

from archerfish.dynamics.array_namespace import Array, lift, namespace


class Track(NamedTuple):
    """A recorded path, linear between its points and at rest before the first and after the last."""

    times: Array
    """[s], rising, shape B + (N,)."""
    places: Array
    """[m], shape B + (N, 3)."""

    def position(self, time: Array) -> Array:
        """Return the position [m] at a time [s], shape B + (3,)."""
        xp = namespace(self.times, self.places, time)
        time = xp.asarray(time)[..., None]
        start, end = (lift(each, time) for each in (self.times[..., :-1], self.times[..., 1:]))
        # Each leg adds the share of it that has been driven: no search, so it batches and compiles.
        share = xp.clip((time - start) / (end - start), 0.0, 1.0)
        legs = self.places[..., 1:, :] - self.places[..., :-1, :]
        way = xp.sum(share[..., None] * lift(legs, share[..., None]), axis=-2)
        return lift(self.places[..., 0, :], way) + way
