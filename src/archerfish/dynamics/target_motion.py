"""How a target moves: eq (7) and others. A motion is a NamedTuple with one function, `position(time)`.

To add one of your own, see docs/adding.md. Every array of it begins with the batch shape B, so one record holds
many targets, and a batch of them can be cut, stacked and chosen from without knowing which motion it is.
"""

from typing import NamedTuple, Protocol

from archerfish.dynamics.array_namespace import Array, lift, namespace


class TargetMotion(Protocol):
    """A path in the gimbal's frame."""

    def position(self, time: Array) -> Array:
        """Return the position [m] at a time [s] since the engagement began, shape B + (3,)."""


class Static(NamedTuple):
    """A target that stands still."""

    place: Array
    """Position [m], shape B + (3,)."""

    def position(self, time: Array) -> Array:
        """Return the position [m] at a time [s], shape B + (3,)."""
        time = namespace(self.place, time).asarray(time)[..., None]
        return lift(self.place, time) + 0.0 * time


class Parabola(NamedTuple):
    """Eq (7): to and fro on x = X₀ + c (y − Y₀)², turning back where |y − Y₀| reaches the half width.

    Eq (7) prints X₀ − 0.04 ≤ x ≤ X₀ + 0.04, but x never falls below X₀ on this parabola; only the upper bound acts
    (docs/errata.md).
    """

    vertex: Array
    """X₀, Y₀ and the constant height [m], shape B + (3,)."""
    speed: Array
    """Lateral speed |ẏ| [m/s], shape B; zero stands still."""
    phase: Array
    """Part of the cycle gone at time zero, 0…1, shape B; 0 is at the right-hand turn, moving left."""
    half_width: Array
    """Largest |y − Y₀| [m], shape B."""
    curvature: Array
    """c [1/m], shape B."""

    def position(self, time: Array) -> Array:
        """Return the position [m] at a time [s], shape B + (3,)."""
        xp = namespace(self.vertex, time)
        lateral = self.half_width * triangle_wave(self.phase + self.speed * time / (4.0 * self.half_width))
        vertex = self.vertex + 0.0 * lateral[..., None]
        forward = vertex[..., 0] + self.curvature * lateral**2
        return xp.stack([forward, vertex[..., 1] + lateral, vertex[..., 2]], axis=-1)


class Line(NamedTuple):
    """A target that drives straight on."""

    start: Array
    """Position at time zero [m], shape B + (3,)."""
    velocity: Array
    """[m/s], shape B + (3,)."""

    def position(self, time: Array) -> Array:
        """Return the position [m] at a time [s], shape B + (3,)."""
        time = namespace(self.start, time).asarray(time)[..., None]
        return lift(self.start, time) + lift(self.velocity, time) * time


class Circle(NamedTuple):
    """A target that drives in a level circle."""

    center: Array
    """[m], shape B + (3,)."""
    radius: Array
    """[m], shape B."""
    angular_rate: Array
    """[rad/s], left positive, shape B."""
    phase: Array
    """Angle at time zero [rad], shape B."""

    def position(self, time: Array) -> Array:
        """Return the position [m] at a time [s], shape B + (3,)."""
        xp = namespace(self.center, time)
        angle = self.phase + self.angular_rate * time
        forward, left = self.radius * xp.cos(angle), self.radius * xp.sin(angle)
        return self.center + xp.stack([forward, left, 0.0 * angle], axis=-1)


class Sinusoid(NamedTuple):
    """A target that swings about a place."""

    center: Array
    """[m], shape B + (3,)."""
    amplitude: Array
    """[m] in each coordinate, shape B + (3,)."""
    angular_frequency: Array
    """[rad/s], shape B."""
    phase: Array
    """[rad], shape B."""

    def position(self, time: Array) -> Array:
        """Return the position [m] at a time [s], shape B + (3,)."""
        xp = namespace(self.center, time)
        return self.center + self.amplitude * xp.sin(self.angular_frequency * time + self.phase)[..., None]


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


class StillOrMoving(NamedTuple):
    """Targets of which some stand still and the others move."""

    place: Array
    """Where those that don't move stand [m], shape B + (3,)."""
    moving: Array
    """Whether a target moves, shape B."""
    motion: TargetMotion
    """How."""

    def position(self, time: Array) -> Array:
        """Return the position [m] at a time [s], shape B + (3,)."""
        moved = self.motion.position(time)
        xp = namespace(self.place, moved)
        return xp.where(lift(xp.asarray(self.moving)[..., None], moved), moved, lift(self.place, moved))


def triangle_wave(cycles: Array) -> Array:
    """Triangle wave of period one between −1 (at whole cycles) and 1, shape B."""
    xp = namespace(cycles)
    return 1.0 - 4.0 * xp.abs(cycles - xp.floor(cycles) - 0.5)
